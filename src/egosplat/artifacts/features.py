"""Schema of ``features.zarr``: aggregated features of instances, supervision of views, codes, decoder."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import COUNT, index_of

FEATURES = Schema(
    "features",
    1,
    {
        "consistent": Field(
            ("instance", "channel"),
            "float32",
            "-",
            "aggregated over the inlier views; 0 where there is no view",
        ),
        "views": Field(
            ("instance",), "int32", "count", "views that were aggregated, outliers among them", values=COUNT
        ),
        "instances/level": Field(
            ("instance",), "int8", "index", "level of each instance", values=index_of("levels")
        ),
        "instance": Field(
            ("view",),
            "int32",
            "index",
            "instance; the rows of view_features.zarr",
            values=index_of("instance"),
        ),
        "frame": Field(("view",), "int32", "index", "frame in frames.zarr", values=COUNT),
        "inlier": Field(("view",), "bool", "-", "views that agree with their instance's median"),
        "supervision": Field(
            ("view", "channel"), "float32", "-", "what the instance means in the frame", by_row=2048
        ),
        "code": Field(("view", "code"), "float32", "-", "supervision, compressed", by_row=65536),
        "consistent_code": Field(("instance", "code"), "float32", "-", "consistent, compressed"),
        "decoder/values": Field(
            ("number",),
            "float32",
            "-",
            "of each layer its (out, in) weights and (out,) biases; the facts name the widths",
        ),
    },
)
