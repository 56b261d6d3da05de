"""Stage ``scene_page``: a scene that answers in the browser, as one HTML file."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES, length_unit
from egosplat.artifacts.provenance import joint_origin
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.errors import UserError
from egosplat.files import write_text
from egosplat.geometry import known_poses
from egosplat.progress import log
from egosplat.query.scene import QueryScene, read_scene
from egosplat.query.scene_query import index_scene
from egosplat.query.text import load_clip_of
from egosplat.query.things import LEAST_GAUSSIANS, NEAREST, REACH, SAME
from egosplat.rasterize.contract import ALPHA_THRESHOLD, FRUSTUM_MARGIN, MAX_ALPHA, Arguments
from egosplat.viewing.container import Arrays, Facts, pack
from egosplat.viewing.frames import pack_frames
from egosplat.viewing.gaussians import keep_largest, pack_gaussians, spatial_order
from egosplat.viewing.html import scene_html
from egosplat.viewing.instances import pack_instances
from egosplat.viewing.options import ScenePageOptions
from egosplat.viewing.palette import pack_codes
from egosplat.viewing.record import record_of
from egosplat.viewing.visibility import pack_visibility
from egosplat.viewing.words import pack_words


@dataclass(frozen=True, eq=False)
class Sources:
    """Artifacts of one scene."""

    frames: Artifact
    poses: Artifact
    instances: Artifact
    features: Artifact
    splats: Artifact
    language: Artifact


SCHEMAS = (FRAMES, POSES, INSTANCES, FEATURES, SPLATS, LANGUAGE)


def run(
    frames_path: Path,
    poses_path: Path,
    instances_path: Path,
    features_path: Path,
    splats_path: Path,
    language_path: Path,
    output: Path,
    options: ScenePageOptions,
    *,
    title: str,
) -> None:
    """Write the page of a scene, whole or not at all.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others; its OpenCLIP is missing; or no frame
            has a pose.
    """
    paths = (frames_path, poses_path, instances_path, features_path, splats_path, language_path)
    text, facts = make_page(paths, options, title)
    write_text(output, text)
    log(f"{output}: {len(text) / 1e6:.1f} MB, {facts['count']} Gaussians")


def make_page(paths: Sequence[Path], options: ScenePageOptions, title: str) -> tuple[str, Facts]:
    """Make the page of a scene from its artifacts, in the order of ``SCHEMAS``.

    Returns:
        The page, and its facts.

    Raises:
        UserError: as ``run``, but for the output.
    """
    sources = Sources(*map(open_artifact, paths, SCHEMAS))
    made_from = lineage(list(vars(sources).values()))
    facts, arrays = scene_data(sources, options)
    facts |= {"title": title, "warnings": warnings_of(*made_from.found.values())}
    facts |= record_of(vars(sources).values(), options)
    return scene_html(f"{title}: egosplat", pack(facts, arrays)), facts


def scene_data(sources: Sources, options: ScenePageOptions) -> tuple[Facts, Arrays]:
    """Pack everything that the page shows or computes with."""
    poses = camera_poses(sources.poses, sources.splats)
    if not len(known_poses(poses)):
        raise UserError(f"{sources.poses.path}: no frame has a pose; see the log of the stage poses")
    made_with = (options.clip_model, options.clip_checkpoint, options.device, options.precision)
    clip = load_clip_of(sources.features, *made_with)
    scene = read_scene(sources.splats, sources.language, sources.features, options.backend)
    index = index_scene(scene, poses, scene.camera, sources.frames.read("valid"))
    kept = keep_largest(scene.gaussians, options.max_gaussians)
    kept = kept[spatial_order(scene.gaussians.means.cpu().numpy()[kept])]
    thinned = scene.gaussians.select(torch.from_numpy(kept).to(scene.code.device))
    code, share = (values.cpu().numpy()[kept] for values in (scene.code, scene.share))
    packed = [
        pack_gaussians(thinned, scene.sh_degree),
        (pack_codes(code, share, scene.decoder), {}),
        pack_visibility(index.surface.shares[:, kept], index.frame),
        (pack_instances(sources.instances, thinned.means.cpu().numpy()), {}),
        pack_words(clip, options.canonical),
        pack_frames(sources.frames, poses),
    ]
    facts, arrays = _about(sources, scene, options), {}
    for more_arrays, more_facts in packed:
        arrays |= more_arrays
        facts |= more_facts
    return facts, arrays


def _about(sources: Sources, scene: QueryScene, options: ScenePageOptions) -> Facts:
    """Facts of the scene, and the constants of queries, which ``source/answer.js`` has no values of its own for."""
    settings, camera = scene.settings, scene.camera
    return {
        "origin": joint_origin(*(artifact.origin for artifact in vars(sources).values())),
        "recording": sources.frames.facts["recording"],
        "checkpoints": _checkpoints(vars(sources).values()),
        "trained_count": scene.gaussians.count,
        "unit": length_unit(sources.poses),
        "up": sources.poses.read("up").tolist(),
        "camera": asdict(camera),
        "near": settings.near_plane,
        "raster": {
            "margin": FRUSTUM_MARGIN,
            "blur": Arguments.__dataclass_fields__["eps2d"].default,
            "least_alpha": ALPHA_THRESHOLD,
            "most_alpha": MAX_ALPHA,
        },
        "white": settings.background == "white",
        "antialiased": settings.antialiased,
        "levels": list(sources.language.facts["levels"]),
        "query": {
            name: getattr(options, name)
            for name in ("temperature", "segmentation_threshold", "box_filter", "min_score")
        }
        | {"nearest": NEAREST, "reach": REACH, "least": LEAST_GAUSSIANS, "same": SAME},
    }


def _checkpoints(artifacts: Any) -> Sequence[str]:
    """Lines such as ``OpenCLIP small, small``."""
    clip = next(artifact.facts["clip"] for artifact in artifacts if "clip" in artifact.facts)
    return [f"OpenCLIP {clip['model']}, {clip['checkpoint']}"]
