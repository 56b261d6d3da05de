"""Schema of ``view_features.zarr``: the feature of each instance in each frame that shows it."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import ANY, COUNT, index_of

VIEW_FEATURES = Schema(
    "view_features",
    1,
    {
        "instance": Field(
            ("view",),
            "int32",
            "index",
            "instance in segments.zarr; rows go by instance, then frame",
            values=index_of("instance"),
        ),
        "frame": Field(
            ("view",), "int32", "index", "frame in frames.zarr; training frames alone", values=COUNT
        ),
        "feature": Field(
            ("view", "channel"),
            "float32",
            "-",
            "OpenCLIP's of the crop, of unit norm",
            by_row=2048,
            values=ANY,
        ),
        "area": Field(("view",), "int32", "px", "pixels of the instance's mask in the frame", values=COUNT),
        "box": Field(("view", 4), "int32", "px", "x0, y0, x1, y1 around the mask, the ends exclusive"),
        "instances/level": Field(
            ("instance",), "int8", "index", "level of each instance, views or none", values=index_of("levels")
        ),
    },
)
