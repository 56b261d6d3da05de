"""Schema of ``masks.zarr``: the transient instances, and the pixels that training masks."""

from egosplat.artifacts.schema import Field, Schema

MASKS = Schema(
    "masks",
    1,
    {
        "refined": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "pixels of a transient instance, of any level that is asked for",
            by_row=True,
        ),
        "instances/score": Field(
            ("instance",),
            "float32",
            "0..1",
            "mean probability over all pixels of the instance in the training frames; 0 without any pixel",
        ),
        "instances/transient": Field(
            ("instance",), "bool", "-", "score at or above the threshold, at a level that is asked for"
        ),
    },
)
