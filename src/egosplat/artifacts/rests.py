"""Schema of ``rests.zarr``: Gaussians of things that lie somewhere for a while, and which rests and carries are of one thing."""

from egosplat.artifacts.schema import (
    ANY,
    COUNT,
    FINITE,
    SHARE,
    Field,
    Schema,
    Values,
    index_of,
    index_or_none,
)

RESTS = Schema(
    "rests",
    1,
    {
        "thing": Field(("rest",), "int32", "index", "the thing that rests", values=index_of("thing")),
        "from_frame": Field(("rest",), "int64", "index", "first frame that shows it there", values=COUNT),
        "until_frame": Field(("rest",), "int64", "index", "last frame that shows it there", values=COUNT),
        "absent_before": Field(
            ("rest",),
            "int64",
            "index",
            "last frame before that shows the place without it, -1 for none",
            values=Values(least=-1),
        ),
        "absent_after": Field(
            ("rest",),
            "int64",
            "index",
            "first frame after that shows the place without it, -1 for none",
            values=Values(least=-1),
        ),
        "center": Field(("rest", 3), "float64", "m", "middle of its Gaussians, in the world", values=FINITE),
        "size": Field(("rest",), "float64", "m", "as that of its carries, their median", values=FINITE),
        "gain": Field(
            ("rest",),
            "float32",
            "0..1",
            "share of the error of the pixels that its Gaussians change, in these frames, which they explain",
            values=SHARE,
        ),
        "best_frame": Field(("rest",), "int64", "index", "frame that shows most of it", values=COUNT),
        "box": Field(("rest", 4), "int32", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "carries/thing": Field(
            ("carry",),
            "int32",
            "index",
            "the thing that each carry of carries.zarr moves, -1 for none that rests",
            values=index_or_none("thing"),
        ),
        "carries/from_rest": Field(
            ("carry",), "int32", "index", "rest before each carry, -1 for none", values=index_or_none("rest")
        ),
        "carries/to_rest": Field(
            ("carry",), "int32", "index", "rest after each carry, -1 for none", values=index_or_none("rest")
        ),
        "things/feature": Field(
            ("thing", "channel"),
            "float32",
            "-",
            "mean of OpenCLIP's features of a thing's rests and carries, of unit norm; zeros without views",
            values=ANY,
        ),
        "gaussians/rest": Field(("gaussian",), "int32", "index", "rest", values=index_of("rest")),
        "gaussians/means": Field(("gaussian", 3), "float32", "m", "as in splats.zarr"),
        "gaussians/quats": Field(("gaussian", 4), "float32", "-", "as in splats.zarr"),
        "gaussians/log_scales": Field(("gaussian", 3), "float32", "log m", "as in splats.zarr"),
        "gaussians/logit_opacities": Field(("gaussian",), "float32", "logit", "as in splats.zarr"),
        "gaussians/sh": Field(("gaussian", "coefficient", 3), "float32", "sRGB 0..1", "as in splats.zarr"),
    },
)
