"""Schema of ``frames.zarr``: the frames of a recording, and how they lie."""

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema

FRAMES = Schema(
    "frames",
    1,
    {
        "rgb": Field(("frame", "height", "width", 3), "uint8", "sRGB", "rectified pictures", by_row=True),
        "valid": Field(("height", "width"), "bool", "-", "pixels inside the lens circle"),
        "timestamp_ns": Field(("frame",), "int64", "ns", "capture time"),
        "exposure_middle_ns": Field(("frame",), "int64", "ns", "middle of the exposure; poses belong to it"),
        "train": Field(("frame",), "bool", "-", "frames to train on"),
        "evaluation": Field(("frame",), "bool", "-", "frames to evaluate on"),
    },
)


def lies_on_its_side(frames: Artifact) -> bool:
    """Whether images lie on their side, as from Aria's sensor (docs/method.md#upright)."""
    # OpenCLIP and the transient network need upright images: they are turned clockwise.
    return frames.facts["format"] == "adt" and not frames.facts["upright"]
