"""The small scenes of other tests."""

from tests.unit.language.conftest import camera_to_world, labels, scene, wall
from tests.unit.segments.conftest import sam2

__all__ = ["camera_to_world", "labels", "sam2", "scene", "wall"]
