"""Read the sizes of a scene and the cost of each stage from finished artifacts."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.artifacts.reader import Artifact, open_any
from egosplat.artifacts.registry import SCHEMAS
from egosplat.cost_model.sizes import LARGE_PIXELS, MASK_BYTES, SMALL_SIDE, images_of_a_frame
from egosplat.pipeline.survey_file import read_survey
from egosplat.survey.motion import SIDE

Sizes = dict[str, float]

_MIB = 2**20
_LEVELS = 3


@dataclass(frozen=True)
class Run:
    """A stage that was run once.

    Attributes:
        stage: its name.
        point: the point of the design, or the scene, that it was run for.
        sizes: of the scene, by name: see ``sizes_of``.
        cpu_s: time on processors [s]; peak_memory_mb: of the process [MiB]; disk_mb: of what it wrote [MiB].
    """

    stage: str
    point: str
    sizes: Sizes
    cpu_s: float
    peak_memory_mb: float
    disk_mb: float


def read_runs(scene: Path, own: Path, point: str, recorded_side: int) -> list[Run]:
    """The runs of all artifacts in a point's own folder.

    Args:
        scene: folder of the scene, with the artifacts that the point shares.
        own: folder of the point's own artifacts; the scene's folder for the center.
        recorded_side: of the recording's pictures [px], which no artifact tells.
    """
    artifacts = {path.stem: open_any(path, SCHEMAS) for path in sorted(scene.glob("*.zarr"))}
    mine = {path.stem: open_any(path, SCHEMAS) for path in sorted(own.glob("*.zarr"))}
    documents = {path.stem: path for folder in (scene, own) for path in sorted(folder.glob("*.json"))}
    sizes = sizes_of(artifacts | mine, documents) | {"recorded_pixels": recorded_side**2}
    runs = [_run(name, point, sizes, artifact.path, artifact.provenance) for name, artifact in mine.items()]
    for name, path in documents.items():
        if path.parent == own:
            runs.append(_run(name, point, sizes, path, json.loads(path.read_text())["provenance"]))
    return runs


def sizes_of(artifacts: dict[str, Artifact], documents: dict[str, Path]) -> Sizes:
    """Sizes of a scene, as far as its artifacts exist.

    Args:
        artifacts: by stage; documents: ``survey.json`` and ``metrics.json``, by stage.

    Returns:
        Numbers by name. ``kept`` counts the frames that the survey keeps, ``training`` those of them that are trained
        on, ``pairs`` the frame pairs that the survey compares, ``images`` the images that SAM2 encodes, as multiples of
        its own size, ``prompts`` the point prompts, ``tracked`` its tracks before short and duplicate ones are removed,
        ``moving`` those beside the masks of single frames, ``masks`` those masks where they are merged, ``runs`` their
        square root, as runs that stay to the last merge grow with it, ``labeled`` the frames with labels, ``shown`` the
        instances in a frame, ``codes`` the numbers in a code at all levels together. ``joint`` equals ``codes`` where
        Gaussians learn codes with their geometry, else 0. ``mean_gaussians`` is the mean over the training.
    """
    readers = {
        "frames": _pictures,
        "poses": lambda one: {"points": one.shape("points/xyz")[0]},
        "instances": _instances,
        "view_features": lambda one: dict(zip(("views", "channels"), one.shape("feature"), strict=True)),
        "features": _codes,
        "transient": _transient,
        "splats": _splats,
    }
    sizes: Sizes = {}
    for name, read in readers.items():
        if name in artifacts:
            sizes |= read(artifacts[name])
    if "segments" in artifacts and "kept_frames" in artifacts["segments"].provenance["options"]:
        kept = read_survey(documents["survey"])["views"]["kept"]
        sizes |= {"kept": len(kept), "training": int(artifacts["frames"].read("train")[kept].sum())}
    if "segments" in artifacts:
        sizes |= _segments(artifacts["segments"], sizes["kept"])
    if "view_features" in artifacts:
        merged = sizes["merging_iterations"] > 0
        sizes |= {"shown": sizes["views"] / sizes["kept"], "merged_views": sizes["views"] * merged}
        sizes["masks"] *= merged
        sizes["runs"] = math.sqrt(sizes["masks"])
    if "survey" in documents:
        pairs = json.loads(documents["survey"].read_text())["motion"]["pairs"]
        sizes |= {"pairs": len(pairs), "surveyed_pixels": min(sizes["pixels"], SIDE**2)}
    if "metrics" in documents:
        sizes["queries"] = len(json.loads(documents["metrics"].read_text())["queries"])
    return sizes


def _pictures(one: Artifact) -> Sizes:
    frames, height, width, _ = one.shape("rgb")
    return {
        "frames": frames,
        "kept": frames,
        "pixels": height * width,
        "training": int(one.read("train").sum()),
        "evaluated": int(one.read("evaluation").sum()),
    }


def _segments(one: Artifact, kept: float) -> Sizes:
    """Sizes of segmentation with the small SAM2."""
    keys, facts = one.provenance["options"], one.facts
    searched = len(facts["key_frames"])
    area = ((keys["image_size"] or SMALL_SIDE) / SMALL_SIDE) ** 2
    if facts["single_frames"]:
        images = searched * images_of_a_frame(keys, area)
        tracks = {"tracked": facts["moving"], "moving": facts["moving"], "sam2_area": 1}
        frames = {"labeled": searched, "masks": facts["found"] - facts["moving"]}
        prompted = images
    else:
        images, prompted = kept * area, searched
        tracks = {"tracked": facts["found"], "moving": 0, "sam2_area": area}
        frames = {"labeled": kept, "masks": 0}
    return {"images": images, "prompts": prompted * keys["points_per_side"] ** 2, **tracks, **frames}


def _instances(one: Artifact) -> Sizes:
    keys, merged = one.provenance["options"], one.facts["source"] != "tracks"
    height, width = one.shape("labels")[2:]
    return {
        "instances": one.shape("instances/level")[0],
        "merging_iterations": keys["iterations"] * merged,
        "merging_pixels": min(keys["resolution"] ** 2, height * width) * merged,
        "merging_gaussians": one.shape("gaussians/xyz")[0],
    }


def _codes(one: Artifact) -> Sizes:
    options = one.provenance["options"]
    trained = options["compression"] == "autoencoder"
    return {
        "codes": _LEVELS * one.shape("code")[1],
        "autoencoder": int(trained),
        "epochs": options["epochs"] if trained else 0,
    }


def _transient(one: Artifact) -> Sizes:
    options = one.provenance["options"]
    iterations = options["iterations"]
    return {
        "initial_iterations": iterations,
        "network_iterations": iterations - round(options["warmup"] * iterations),
        "initial_pixels": math.prod(one.facts["working_size"]),
        "large_initial_pixels": max(0, math.prod(one.facts["working_size"]) - LARGE_PIXELS),
        "network_pixels": options["input_size"] ** 2,
        "initial_gaussians": one.facts["gaussians"],
    }


def _splats(one: Artifact) -> Sizes:
    gaussians, joint = one.shape("features")
    options = one.provenance["options"]
    return {
        "iterations": one.facts["iteration"],
        "gaussians": gaussians,
        "mean_gaussians": float(one.read("curve/gaussians").mean()),
        "joint": joint,
        "corrected": int("on" in (options["refine_poses"], options["compensate_exposure"])),
        "mask_bytes": MASK_BYTES[options["masking"]],
    }


def _run(stage: str, point: str, sizes: Sizes, path: Path, made: dict[str, Any]) -> Run:
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    disk = sum(file.stat().st_size for file in files) / _MIB
    return Run(stage, point, sizes, made["cpu_s"], made["peak_memory_mb"], round(disk, 4))
