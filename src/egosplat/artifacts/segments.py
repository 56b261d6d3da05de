"""Schema of ``segments.zarr``: instances at up to three levels, tracked through the video."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import COUNT, FINITE, SHARE, index_of, index_or_none

# The arrays that instances.zarr has, too.
LABELED = {
    "labels": Field(
        ("frame", "level", "height", "width"),
        "int32",
        "index",
        "instance that the pixel belongs to at the level, -1 for none; levels as the facts name them",
        by_row=True,
        values=index_or_none("instance"),
    ),
    "instances/level": Field(
        ("instance",),
        "int8",
        "index",
        "level of the instance; it is seen at no other",
        values=index_of("level"),
    ),
}

SEGMENTS = Schema(
    "segments",
    2,
    {
        **LABELED,
        "instances/predicted_iou": Field(
            ("instance",),
            "float32",
            "0..1",
            "IoU that SAM2 predicts for the mask that began it; 1 without SAM2",
            values=FINITE,
        ),
        "instances/stability": Field(
            ("instance",),
            "float32",
            "0..1",
            "IoU of that mask cut a little higher and lower; 1 without SAM2",
            values=SHARE,
        ),
        "instances/first_frame": Field(
            ("instance",), "int64", "index", "frame whose prompts began it", values=COUNT
        ),
        "instances/moving": Field(
            ("instance",), "bool", "-", "tracked, because the transient network says that it moves"
        ),
    },
)
