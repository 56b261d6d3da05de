"""Stage ``scene_page``: a scene that answers in the browser, as one HTML file."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.lineage import open_inputs
from egosplat.artifacts.provenance import joint_origin
from egosplat.artifacts.reader import Artifact
from egosplat.files import write_text
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Array, known_poses
from egosplat.histories.known import Histories, Rests
from egosplat.histories.told import APART
from egosplat.images import encode_webp, evenly_spaced, shrink_image
from egosplat.progress import log
from egosplat.query import grades
from egosplat.query.answers import as_json
from egosplat.query.finished_scene import Scene, scene_of
from egosplat.query.text import PARTS, SYNONYM
from egosplat.query.things import LEAST_GAUSSIANS, NEAREST, REACH, SAME
from egosplat.rasterize.contract import ALPHA_THRESHOLD, FRUSTUM_MARGIN, MAX_ALPHA, Arguments
from egosplat.viewing.gaussians import (
    keep_largest,
    pack_codes,
    pack_gaussians,
    pack_visibility,
    spatial_order,
)
from egosplat.viewing.html import Arrays, Facts, pack, record_of, scene_html
from egosplat.viewing.options import ScenePageOptions
from egosplat.viewing.words import pack_sizes, pack_words

# Decimals of a time [s]; largest number of pictures, their longer side [px] and the quality of WebP.
SECOND, PICTURES, SIDE, QUALITY = 2, 40, 256, 60


def run(*, output: Path, options: ScenePageOptions, title: str, **paths: Path | None) -> None:
    """Write the page of a scene, whole or not at all; with what is carried, and what rests, if it is known (UserError: an artifact is
    missing, damaged or does not belong to the others; its OpenCLIP is missing; or no frame has a pose)."""
    write_page(scene_of(open_inputs(paths).values(), options), output, options, title)


def write_page(scene: Scene, output: Path, options: ScenePageOptions, title: str) -> None:
    """Write what ``make_page`` makes."""
    text, facts = make_page(scene, options, title)
    write_text(output, text)
    log(f"{output}: {len(text) / 1e6:.1f} MB, {facts['count']} Gaussians")


def make_page(scene: Scene, options: ScenePageOptions, title: str) -> tuple[str, Facts]:
    """Make the page of a scene that was opened with all inputs of the stage; with its facts."""
    facts, arrays = scene_data(scene, options)
    facts |= {"title": title, "warnings": warnings_of(*scene.made_from.found.values())}
    facts |= record_of(scene.given, options, None if scene.checked else scene.folder)
    return scene_html(f"{title}: egosplat", pack(facts, arrays)), facts


def scene_data(scene: Scene, options: ScenePageOptions) -> tuple[Facts, Arrays]:
    """Pack everything that the page shows or computes with."""
    surface, trained = scene.surface, scene.trained
    kept = keep_largest(trained.gaussians, options.max_gaussians)
    kept = kept[spatial_order(trained.gaussians.means.cpu().numpy()[kept])]
    thinned = trained.gaussians.select(torch.from_numpy(kept).to(trained.code.device))
    code, share = (values.cpu().numpy()[kept] for values in (trained.code, trained.share))
    every, of_rests = add_rests(thinned, scene.rests)
    facts, arrays = _about(scene, options), pack_codes(code, share, trained.decoder)
    # Tracks are not in 3D.
    if surface.instance is not None:
        arrays["instance"] = (scene.instances[:, kept] + 1).clip(0, 65535).astype(np.uint16)
    for more_arrays, more_facts in (
        pack_gaussians(every, trained.sh_degree),
        pack_visibility(surface.shares[:, kept], surface.frame),
        pack_words(scene),
        pack_sizes(scene.asked.sizes, options.size_weight),
        pack_frames(scene.artifact("frames"), scene.poses, scene.seconds),
        pack_carries(scene.histories),
        ({}, of_rests),
    ):
        arrays |= more_arrays
        facts |= more_facts
    return facts, arrays


def _about(scene: Scene, options: ScenePageOptions) -> Facts:
    """Facts of the scene, and the constants of queries, which ``source/answer.js`` has no values of its own for."""
    settings, clip = scene.trained.settings, scene.encoded.facts["clip"]
    grading = scene.grading(options)
    raster = {"margin": FRUSTUM_MARGIN, "blur": Arguments.__dataclass_fields__["eps2d"].default}
    keys = ("temperature", "segmentation_threshold", "box_filter", "min_score")
    limits = asdict(grading) | {"nearest": NEAREST, "reach": REACH}
    limits |= {"least": LEAST_GAUSSIANS, "same": SAME, "apart": APART, "fits": grades.LEAST_FIT}
    limits |= {"synonym": SYNONYM, "parts": PARTS}
    return {
        "origin": joint_origin(scene.given),
        "recording": scene.artifact("frames").facts["recording"],
        "checkpoints": [f"OpenCLIP {clip['model']}, {clip['checkpoint']}"],
        "trained_count": scene.gaussians.count,
        "unit": scene.unit,
        "up": scene.artifact("poses").read("up").tolist(),
        "camera": asdict(scene.camera),
        "near": settings.near_plane,
        "raster": raster | {"least_alpha": ALPHA_THRESHOLD, "most_alpha": MAX_ALPHA},
        "white": settings.background == "white",
        "levels": list(scene.levels),
        "query": {name: getattr(options, name) for name in keys} | limits,
    }


def add_rests(gaussians: Gaussians, rests: Rests | None) -> tuple[Gaussians, Facts]:
    """Append the Gaussians of rests, one rest after the other; the facts tell their number and time [s]."""
    every, about = gaussians, []
    if rests is not None:
        order = np.argsort(rests.rest, kind="stable")
        more = rests.gaussians.select(torch.from_numpy(order).to(gaussians.means.device))
        every = Gaussians.concatenate([gaussians, more])
        counts = np.bincount(rests.rest, minlength=len(rests.thing))
        rows = zip(*np.round([rests.from_s, rests.until_s], SECOND).tolist(), counts.tolist(), strict=True)
        about = [{"from": first, "until": last, "count": count} for first, last, count in rows]
    return every, {"count": gaussians.count, "drawn": every.count, "rests": about}


def pack_carries(histories: Histories | None) -> tuple[Arrays, Facts]:
    """Pack ``carried_vectors`` (T, D) float16, features of things that are carried, and when each is and from where to where."""
    if histories is None or not histories.things:
        return {}, {"carried_things": []}
    vectors = {"carried_vectors": histories.features.numpy().astype(np.float16)}
    return vectors, {"carried_things": as_json(histories.things)}


def pack_frames(frames: Artifact, camera_to_world: Array, seconds: Array) -> tuple[Arrays, Facts]:
    """Pack ``poses`` (P, 3, 4) float32 of the (F, 4, 4) that are not NaN, ``seconds`` since the first frame, and ``pictures``.

    These are uint8, WebP files of some frames in a row."""
    posed = known_poses(camera_to_world)
    shown = posed[evenly_spaced(len(posed), PICTURES)].tolist()
    files = [encode_webp(shrink_image(frames.row("rgb", frame), SIDE), QUALITY) for frame in shown]
    pictures = np.concatenate([*files, np.zeros(0, np.uint8)])
    return {"poses": camera_to_world[posed, :3].astype(np.float32), "pictures": pictures}, {
        "frames": posed.tolist(),
        "seconds": np.round(seconds[posed], SECOND).tolist(),
        "pictures": [{"frame": frame, "bytes": len(file)} for frame, file in zip(shown, files, strict=True)],
    }
