"""Schema of ``masks.zarr``: the transient instances, and the pixels that training masks."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import SHARE

# Why nothing is masked, in the fact ``withheld``.
BY_NETWORK, BY_INSTANCES = "probability", "instances"

MASKS = Schema(
    "masks",
    2,
    {
        "refined": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "pixels of a transient instance, of any level that is asked for, where the network calls them transient, "
            "and of regions that the network is sure of for several frames",
            by_row=True,
        ),
        "instances/score": Field(
            ("instance",),
            "float32",
            "0..1",
            "mean probability over all pixels of the instance in the training frames; 0 without any pixel",
            values=SHARE,
        ),
        "instances/stands_out": Field(
            ("instance",),
            "float32",
            "0..1",
            "share of the instance's pixels that stand out (transient.zarr), in training frames where this was measured",
            values=SHARE,
        ),
        "instances/transient": Field(
            ("instance",),
            "bool",
            "-",
            "transient by score and by what stands out, at a level that is asked for",
        ),
    },
)
