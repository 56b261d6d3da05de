"""Schema of ``prompts.zarr``: the points that SAM2 is prompted with in each training frame."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import COUNT, SHARE

PROMPTS = Schema(
    "prompts",
    1,
    {
        "frame": Field(
            ("point",), "int32", "index", "training frame in frames.zarr, in rising order", values=COUNT
        ),
        "position": Field(
            ("point", 2), "float32", "0..1", "x, y, relative to the image's sides", values=SHARE
        ),
    },
)
