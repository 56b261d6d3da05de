"""Gaussians that move to another world look the same from a camera that moves along."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.gaussians.render import render
from egosplat.gaussians.similarity import moved, split_similarity
from tests.support.gaussian_scene import CAMERA, SETTINGS
from tests.support.splats import colorful


def similarity(seed: int, scale: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return matrix


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("scale", [1.0, 0.3, 12.0])
def test_a_camera_that_moves_along_sees_the_same(truth, camera_to_world, degree, scale):
    gaussians, matrix = colorful(truth, degree), similarity(degree, scale)
    pose = camera_to_world[2]
    along = matrix @ pose
    along[:3, :3] /= scale
    near = replace(SETTINGS, near_plane=0.1 * scale)
    before, after = (
        render(each, CAMERA, where, settings, sh_degree=degree, background=None)[0]
        for each, where, settings in ((gaussians, pose, SETTINGS), (moved(gaussians, matrix), along, near))
    )
    # The renderer widens Gaussians by a share of a pixel, whatever the scale.
    torch.testing.assert_close(after, before, atol=2e-4, rtol=0)


@pytest.mark.parametrize(
    "diagonal", [[1.0, 1, -1, 1], [1.0, 2, 1, 1], [0.0] * 4, [np.nan] * 4, [1e39] * 3 + [1], [1e300] * 4]
)
def test_what_is_no_similarity_is_refused(diagonal):
    with pytest.raises(ValueError, match="rotation"):
        split_similarity(np.diag(diagonal))
