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
        "frame": Field("int32 view", "index", "training frame in frames.zarr", COUNT),
        **{
            scale_name(number): Field(
                f"float16 view row_{number} column_{number} channel",
                "-",
                "OpenCLIP feature of each tile, of unit norm; 0 without one; the facts have side and stride",
                by_row=True,
            )
            for number in range(SCALES)
        },
        "regulariser": Field(
            "float16 view row column component",
            "-",
            "principal components of the frame's SAM2 map, each channel of variance 1; none if tiles.regulariser is none",
            by_row=True,
            optional=True,
        ),
    },
)
