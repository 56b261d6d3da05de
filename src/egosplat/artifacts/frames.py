"""Schema of ``frames.zarr``: the frames of a recording."""

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
