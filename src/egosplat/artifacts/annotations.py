"""Schema of ``annotations.zarr``: instance maps of the evaluation frames. For evaluation only."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import COUNT, index_or_none

ANNOTATIONS = Schema(
    "annotations",
    1,
    {
        "frame": Field(
            ("evaluation",), "int64", "index", "index of the evaluation frame in frames.zarr", values=COUNT
        ),
        "annotated": Field(("evaluation",), "bool", "-", "whether the frame has an annotation"),
        "instance_map": Field(
            ("evaluation", "height", "width"),
            "int32",
            "index",
            "index into the instances of the facts, -1 where nothing is annotated",
            by_row=True,
            values=index_or_none("instances"),
        ),
        "covered_map": Field(
            ("evaluation", "layer", "height", "width"),
            "int32",
            "index",
            "the same for the instances that others cover in part, whole, in as many layers as they need",
            by_row=True,
            optional=True,
            values=index_or_none("instances"),
        ),
    },
)
