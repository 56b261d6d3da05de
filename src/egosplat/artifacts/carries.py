"""Schema of ``carries.zarr``: things that leave a place and are put down at another."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.integrity import damaged
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import ANY, COUNT, FINITE, FINITE_OR_UNKNOWN

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
        "end": Field(("carry", 3), "float64", "m", "where it is put down", values=FINITE),
        "size": Field(
            ("carry",), "float64", "m", "side of a square as large as its masks, their median", values=FINITE
        ),
        "best_frame": Field(("carry",), "int64", "index", "frame that shows most of it", values=COUNT),
        "box": Field(("carry", 4), "int32", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "feature": Field(
            ("carry", "channel"),
            "float32",
            "-",
            "mean of OpenCLIP's features of its views, of unit norm; zeros without views",
            values=ANY,
        ),
    },
)


def check_frames(carries: Artifact, count: int, **frames: NDArray[np.int64]) -> None:
    """Check that carries lie in a recording, and that none ends before it begins.

    Args:
        carries: the artifact, for the error.
        count: number of frames of the recording.
        frames: its arrays of frames by name, ``first_frame`` and ``last_frame`` among them.

    Raises:
        ArtifactError: one does not, as in a file that was edited.
    """
    for name, values in frames.items():
        if (values >= count).any():
            raise damaged(
                carries.path, f"{name!r} tells of frame {values.max()}, and the recording has {count}"
            )
    back = frames["first_frame"] > frames["last_frame"]
    if back.any():
        raise damaged(carries.path, f"{back.sum()} of {len(back)} carries end before they begin")
