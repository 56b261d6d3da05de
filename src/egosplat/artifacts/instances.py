"""Schema of ``instances.zarr``: things that hold in 3D, or the tracks of segments.zarr unchanged."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.segments import LABELED
from egosplat.artifacts.values import COUNT, index_or_none

# Value of the fact ``source``: the tracks of segments.zarr, unchanged.
TRACKS = "tracks"

INSTANCES = Schema(
    "instances",
    1,
    {
        **LABELED,
        "instances/parent": Field(
            ("instance",),
            "int32",
            "index",
            "instance of the next coarser level that holds most of it in 3D, -1 for none",
            values=index_or_none("instance"),
        ),
        "instances/masks": Field(
            ("instance",),
            "int32",
            "count",
            "masks of segments.zarr that are merged in it; of what moves, the frames that show it; else 1 for a track",
            values=COUNT,
        ),
        "instances/moving": Field(
            ("instance",), "bool", "-", "a track of segments.zarr of something that moves, not merged in 3D"
        ),
        "gaussians/xyz": Field(
            ("gaussian", 3), "float32", "m", "centers of the Gaussians that masks are merged on"
        ),
        "gaussians/instance": Field(
            ("gaussian", "level"),
            "int32",
            "index",
            "instance that the Gaussian belongs to at the level, -1 for none",
            values=index_or_none("instance"),
        ),
    },
)


def is_track(instances: Artifact) -> NDArray[np.bool_]:
    """(N,) the instances that are tracks; the others are masks that are merged in 3D."""
    moving = instances.read("instances/moving")
    return np.ones_like(moving) if instances.facts["source"] == TRACKS else moving
