"""The measured points: a center, one factor changed at a time, and a corner where all factors are large."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# All stages together take a minute or two. Nothing is masked, so the Gaussians need no instances.
CENTER: Mapping[str, Mapping[str, Any]] = {
    "synthetic": {"size": 512, "fps": 3.0, "seconds": 16.0},
    "frames": {"resolution": 192, "end_s": 7.9, "evaluation_frames": 4},
    "survey": {"min_view_change_deg": 0, "blur_limit": 0},
    "segments": {"points_per_side": 8, "key_frame_stride": 8, "track_moving": "never"},
    "instances": {"resolution": 96, "iterations": 60},
    "features": {"compression": "linear", "dims": 16},
    "transient": {
        "iterations": 80,
        "resolution": 96,
        "input_size": 96,
        "max_points": 10_000,
        "max_gaussians": 10_000,
    },
    "splats": {"masking": "none", "iterations": 150, "max_points": 10_000, "max_gaussians": 10_000},
}

PICTURES = ("frames", "annotations", "poses", "survey")
INSTANCES = ("segments", "instances", "view_features", "features")
MOVING = ("transient", "masks")
GAUSSIANS = ("splats", "language", "metrics")
# The measured stages: those of a recorded sequence.
STAGES = PICTURES + INSTANCES + MOVING + GAUSSIANS


@dataclass(frozen=True)
class Point:
    """One measured configuration.

    Attributes:
        name: unique, usable as a file name.
        factor, value: name and value of the changed factor, as text.
        keys: override those of the center, by section.
        stages: that depend on the factor and run again.
        scene: of the recording.
    """

    name: str
    factor: str
    value: str
    keys: Mapping[str, Mapping[str, Any]]
    stages: tuple[str, ...]
    scene: str = field(default="apartment")


def _gaussians(count: int) -> dict[str, dict[str, Any]]:
    most = {"max_points": count, "max_gaussians": count}
    return {"splats": most, "transient": most}


def _joint(dims: int) -> dict[str, dict[str, Any]]:
    return {"features": {"dims": dims}, "splats": {"language": "joint"}}


def _tracks(most: int) -> dict[str, dict[str, Any]]:
    """SAM2's tracks, of the size of its own input."""
    return {"segments": {"prompting": "key_frames", "image_size": 320, "max_instances": most}}


def _autoencoder(epochs: int) -> dict[str, dict[str, Any]]:
    return {"features": {"compression": "autoencoder", "epochs": epochs}}


CORRECTED = {"refine_poses": "on", "compensate_exposure": "on"}

# All factors are large, which separates terms that are products.
CORNER = {
    "frames": {"resolution": 512, "end_s": None, "evaluation_frames": 12},
    "segments": {"key_frame_stride": 4},
    "instances": {"resolution": 256, "iterations": 150},
    "transient": {"resolution": 512, "max_points": 35_000, "max_gaussians": 35_000},
    "splats": {"max_points": 35_000, "max_gaussians": 35_000},
}

WITHOUT_SCORES = tuple(stage for stage in STAGES if stage != "metrics")
MEANT = (*INSTANCES, "masks", "language")

POINTS = (
    Point("center", "none", "the center", {}, STAGES),
    Point("frames-12", "frames", "12", {"frames": {"end_s": 3.9}}, WITHOUT_SCORES),
    Point("frames-48", "frames", "48, of them 12 evaluated", {"frames": {"end_s": None, "evaluation_frames": 12}}, STAGES),
    Point("side-128", "side of the pictures", "128 px", {"frames": {"resolution": 128}}, WITHOUT_SCORES),
    Point("side-288", "side of the pictures", "288 px", {"frames": {"resolution": 288}}, STAGES),
    Point("side-384", "side of the pictures", "384 px", {"frames": {"resolution": 384}}, STAGES),
    Point("recorded-256", "side of the recording", "256 px", {}, ("frames", "annotations"), "small"),
    Point("tracks-4", "tracks", "at most 4 a level", _tracks(4), MEANT),
    Point("tracks-30", "tracks", "at most 30 a level", _tracks(30), MEANT),
    Point("prompts-16", "prompts", "16 x 16", {"segments": {"points_per_side": 16}}, ("segments", "instances")),
    Point("merging-200", "iterations", "200", {"instances": {"iterations": 200}}, ("instances",)),
    Point("merging-192", "side merged at", "192 px", {"instances": {"resolution": 192}}, ("instances",)),
    Point("gaussians-3000", "Gaussians", "3,000", _gaussians(3000), ("transient", *GAUSSIANS)),
    Point("gaussians-20000", "Gaussians", "20,000", _gaussians(20000), ("transient", "splats", "language")),
    Point("gaussians-35000", "Gaussians", "35,000", _gaussians(35000), ("transient", *GAUSSIANS)),
    Point("splats-60", "iterations", "60", {"splats": {"iterations": 60}}, ("splats",)),
    Point("splats-400", "iterations", "400", {"splats": {"iterations": 400}}, ("splats",)),
    Point("transient-30", "iterations", "30", {"transient": {"iterations": 30}}, ("transient",)),
    Point("transient-200", "iterations", "200", {"transient": {"iterations": 200}}, ("transient",)),
    Point("compared-192", "side compared at", "192 px", {"transient": {"resolution": 192}}, ("transient",)),
    Point("network-64", "side of the network", "64 px", {"transient": {"input_size": 64}}, ("transient",)),
    Point("network-224", "side of the network", "224 px", {"transient": {"input_size": 224}}, ("transient",)),
    Point("corrected", "camera", "corrected", {"camera": CORRECTED}, ("splats",)),
    Point("joint-3", "codes learned jointly", "3 dims", _joint(3), ("features", "splats")),
    Point("joint-16", "codes learned jointly", "16 dims", _joint(16), ("splats",)),
    Point("autoencoder-20", "epochs", "20", _autoencoder(20), ("features",)),
    Point("autoencoder-400", "epochs", "400", _autoencoder(400), ("features",)),
    Point("corner", "all of them", "at their most, 512 px", CORNER, STAGES),
)  # fmt: skip

# The options of each scene in the table of scenes.
SCENES = {
    "apartment": "synthetic.seed=1",
    "small": "synthetic.seed=1 synthetic.size=256",
}
