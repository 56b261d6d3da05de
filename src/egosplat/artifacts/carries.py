"""Schema of ``carries.zarr``: things that leave a place and are put down at another."""

from egosplat.artifacts.schema import ANY, COUNT, FINITE, FINITE_OR_UNKNOWN, Field, Schema

CARRIES = Schema(
    "carries",
    1,
    {
        "instance": Field(
            ("carry",), "int32", "index", "track in instances.zarr that shows most of it", values=COUNT
        ),
        "first_frame": Field(
            ("carry",), "int64", "index", "frame in which it leaves its place", values=COUNT
        ),
        "last_frame": Field(
            ("carry",),
            "int64",
            "index",
            "frame from which it lies still again, or the last that shows it",
            values=COUNT,
        ),
        "start": Field(
            ("carry", 3),
            "float64",
            "m",
            "where it lay before, in the world; NaN if not known",
            values=FINITE_OR_UNKNOWN,
        ),
        "end": Field(
            ("carry", 3), "float64", "m", "where it is put down; NaN if not known", values=FINITE_OR_UNKNOWN
        ),
        "size": Field(
            ("carry",), "float64", "m", "side of a square as large as its masks, their median", values=FINITE
        ),
        "best_frame": Field(("carry",), "int64", "index", "frame that shows most of it", values=COUNT),
        "box": Field(("carry", 4), "int32", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "feature": Field(
            ("carry", "channel"),
            "float32",
            "-",
            "mean of OpenCLIP's features of its views and of those of carries that look alike, of unit norm; zeros without views",
            values=ANY,
        ),
    },
)
