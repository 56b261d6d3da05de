"""Schema of ``poses.zarr``: camera poses and points."""

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import PINHOLE, POSES_OR_UNKNOWN, UNIT_VECTOR

POSES = Schema(
    "poses",
    1,
    {
        "camera_to_world": Field(
            ("frame", 4, 4), "float64", "m", "OpenCV axes; NaN where not registered", values=POSES_OR_UNKNOWN
        ),
        "registered": Field(("frame",), "bool", "-", "frames that have a pose"),
        "intrinsics": Field(
            (3, 3), "float64", "px", "pinhole matrix, pixel centers at + 0.5", values=PINHOLE
        ),
        "up": Field((3,), "float64", "-", "unit vector against gravity, in the world", values=UNIT_VECTOR),
        "points/xyz": Field(("point", 3), "float64", "m", "points of the scene, in the world"),
        "points/rgb": Field(("point", 3), "uint8", "sRGB", "their colors"),
    },
)


def length_unit(poses: Artifact) -> str:
    """The unit of lengths in the scene's world: ``m``, or ``scene units`` where COLMAP's scale is arbitrary."""
    return "scene units" if poses.facts.get("notes", {}).get("scale") == "arbitrary" else "m"
