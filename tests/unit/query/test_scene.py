"""A trained scene is rendered with the settings that it was trained with."""

from dataclasses import asdict

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SPLATS
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Camera
from egosplat.query.scene import read_trained_scene
from tests.support.scenes import put

CAMERA = Camera(16, 12, 12.0, 12.0, 8.0, 6.0)


@pytest.fixture
def scene(tmp_path):
    """``scene(background=, degree=)``: one Gaussian ahead, green where its harmonics are used."""

    def make(background: str = "black", degree: int = 1):
        sh = np.zeros((1, 4, 3), np.float32)
        sh[0, 2, 1] = 1.0  # along z
        splats = {
            "means": np.float32([[0, 0, 2]]),
            "log_scales": np.full((1, 3), -2.0, np.float32),
            "logit_opacities": np.float32([9.0]),
            "sh": sh,
        }
        facts = {"camera": asdict(CAMERA), "sh_degree_in_use": degree}
        options = {"near_plane": 0.5, "antialiased": True, "background": background}
        put(tmp_path, "splats", splats, facts, options=options)
        return read_trained_scene(open_artifact(tmp_path / "splats.zarr", SPLATS), "auto")

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
    assert made.camera == CAMERA and made.settings == RenderSettings(0.5, "black", False, "auto")
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert (made.picture(CAMERA, behind) == 0).all()
    near = np.eye(4)
    near[2, 3] = 1.6
    assert (made.picture(CAMERA, near) == 0).all()  # nearer than the plane
