"""The scene of known Gaussians, and a pretended GPU."""

from tests.support.gaussian_scene import camera_to_world, pictures, points, scene, truth
from tests.unit.pretended_gpu.conftest import gpu

__all__ = ["camera_to_world", "gpu", "pictures", "points", "scene", "truth"]
