"""Schema of ``language.zarr``: a code for each Gaussian of ``splats.zarr`` and each level."""

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import ANY, COUNT, SHARE

# The fact ``decoded``: queries decode the code of each Gaussian and render relevancies, or they render codes and decode
# pixels. Trained codes are right where they are rendered; the code of a single one of these Gaussians means nothing.
GAUSSIANS, PIXELS = "gaussians", "pixels"

LANGUAGE = Schema(
    "language",
    1,
    {
        "code": Field(
            ("gaussian", "level", "channel"),
            "float32",
            "-",
            "code, for the artifact's own decoder or that of features.zarr; 0 where the share is 0; levels as the facts name them",
        ),
        "share": Field(
            ("gaussian", "level"),
            "float32",
            "0..1",
            "share of what the Gaussian shows in the training views at which the level has an instance with a code",
            values=SHARE,
        ),
        "decoder/values": Field(
            ("number",),
            "float32",
            "-",
            "as in features.zarr, of a decoder that the method learns",
            optional=True,
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record of training", values=COUNT
        ),
        "curve/loss": Field(
            ("record",),
            "float64",
            "-",
            "mean loss of the iterations since the record before; none if not trained",
            values=ANY,
        ),
    },
)
