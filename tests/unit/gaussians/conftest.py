"""A small scene with images of known Gaussians."""

from tests.support.gaussian_scene import camera_to_world, pictures, points, scene, truth

__all__ = ["camera_to_world", "pictures", "points", "scene", "truth"]
