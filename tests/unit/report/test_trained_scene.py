"""Gaussians are drawn as they were trained to be."""

from dataclasses import asdict

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.report.trained_scene import open_trained_scene
from tests.support.scenes import put

CAMERA = Camera(16, 12, 12.0, 12.0, 8.0, 6.0)


@pytest.fixture
def scene(tmp_path):
    """``scene(background=, degree=, made_from=)``: one Gaussian ahead, green where its harmonics are used."""

    def make(background: str = "black", degree: int = 1, made_from: str | None = None):
        sh = np.zeros((1, 4, 3), np.float32)
        sh[0, 2, 1] = 1.0  # along z
        poses = {"registered": np.ones(1, bool), "intrinsics": CAMERA.matrix}
        splats = {
            "means": np.float32([[0, 0, 2]]),
            "log_scales": np.full((1, 3), -2.0, np.float32),
            "logit_opacities": np.float32([9.0]),
            "sh": sh,
        }
        facts = {"camera": asdict(CAMERA), "sh_degree_in_use": degree}
        options = {"near_plane": 0.5, "antialiased": True, "background": background}
        put(tmp_path, "poses", poses, facts)
        inputs = {"poses.zarr": made_from} if made_from else {}
        put(tmp_path, "splats", splats, facts, made_from=["poses"], inputs=inputs, options=options)
        return open_trained_scene(tmp_path / "poses.zarr", tmp_path / "splats.zarr")

    return make


@pytest.mark.parametrize("background, expected", [("black", 0.0), ("white", 1.0), ("random", 0.0)])
def test_the_background_is_the_one_of_training(scene, background, expected):
    picture = scene(background).picture(CAMERA, np.eye(4))
    assert picture.shape == (12, 16, 3) and picture.dtype == np.float32
    np.testing.assert_allclose(picture[0, 0], expected, atol=1e-6)
    assert picture[6, 8].std() > 0.1


def test_harmonics_are_used_up_to_the_degree_in_use(scene):
    with_direction, without = (scene(degree=degree).picture(CAMERA, np.eye(4))[6, 8] for degree in (1, 0))
    assert with_direction[1] > with_direction[0] + 0.1
    np.testing.assert_allclose(without, without[0], atol=1e-6)


def test_render_settings_come_from_training(scene):
    made = scene()
    assert made.camera == CAMERA and made.near_plane == 0.5 and made.antialiased
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert (made.picture(CAMERA, behind) == 0).all()
    near = np.eye(4)
    near[2, 3] = 1.6
    assert (made.picture(CAMERA, near) == 0).all()  # nearer than the plane


def test_gaussians_of_other_poses_are_rejected(scene):
    with pytest.raises(UserError, match=r"splats.zarr: was made from another poses.zarr than .*Rebuild it: "):
        scene(made_from="0" * 64)
