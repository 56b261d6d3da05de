"""Schema of ``tiles.zarr``: OpenCLIP features of the tiles of each training frame, at seven scales."""

from egosplat.artifacts.schema import COUNT, Field, Schema

SCALES = 7


def scale_name(number: int) -> str:
    """Name of the array of a scale, 0 for the smallest tiles."""
    return f"scale/{number}"


TILES = Schema(
    "tiles",
    1,
    {
        "frame": Field(("view",), "int32", "index", "training frame in frames.zarr", values=COUNT),
        **{
            scale_name(number): Field(
                ("view", f"row_{number}", f"column_{number}", "channel"),
                "float16",
                "-",
                "OpenCLIP feature of each tile, of unit norm; 0 without one; the facts have side and stride",
                by_row=True,
            )
            for number in range(SCALES)
        },
        "regulariser": Field(
            ("view", "row", "column", "component"),
            "float16",
            "-",
            "principal components of the frame's SAM2 map, each channel of variance 1; none if tiles.regulariser is none",
            by_row=True,
            optional=True,
        ),
    },
)
