"""Schema of ``transient.zarr``: the probability that a pixel is transient, before refinement."""

from egosplat.artifacts.schema import Field, Schema

TRANSIENT = Schema(
    "transient",
    1,
    {
        "probability": Field(
            ("frame", "height", "width"),
            "float16",
            "0..1",
            "the network's probability that the pixel is of something transient, of frames without a pose too",
            by_row=True,
        ),
        "weights": Field(
            ("number",), "float32", "-", "the network's tensors, flat, one after the other; facts name them"
        ),
        "curve/iteration": Field(("record",), "int64", "iteration", "last iteration of each record"),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before"
        ),
        "curve/probability": Field(
            ("record",), "float64", "0..1", "mean probability in the same iterations; 0 in the warm-up"
        ),
    },
)
