"""Schema of ``frames.zarr``: the frames of a recording, and how they lie."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema

FRAMES = Schema(
    "frames",
    1,
    {
        "rgb": Field(("frame", "height", "width", 3), "uint8", "sRGB", "rectified pictures", by_row=True),
        "valid": Field(("height", "width"), "bool", "-", "pixels inside the lens circle"),
        "masked": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "valid pixels that a frame's own mask or transparency leaves out",
            by_row=True,
            optional=True,
        ),
        "timestamp_ns": Field(("frame",), "int64", "ns", "capture time"),
        "exposure_middle_ns": Field(("frame",), "int64", "ns", "middle of the exposure; poses belong to it"),
        "train": Field(("frame",), "bool", "-", "frames to train on"),
        "evaluation": Field(("frame",), "bool", "-", "frames to evaluate on"),
    },
)


def shown_pixels(frames: Artifact, index: int, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) bool: the pixels of a frame that show the scene; ``valid`` is the array of this name."""
    return valid & ~frames.row("masked", index) if frames.has("masked") else valid


def seconds_of(frames: Artifact) -> NDArray[np.float64]:
    """(F,) time of each frame since the first [s]."""
    times = frames.read("timestamp_ns")
    return (times - times[:1]) / 1e9


def lies_on_its_side(frames: Artifact) -> bool:
    """Whether images lie on their side, as from Aria's sensor (docs/method.md#upright)."""
    # OpenCLIP and the transient network need upright images: they are turned clockwise.
    return frames.facts["format"] == "adt" and not frames.facts["upright"]
