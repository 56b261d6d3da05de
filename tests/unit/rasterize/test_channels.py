"""Helpers shared by the backends."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.geometry import invert, make_pose
from egosplat.rasterize.channels import camera_centers, finish, stack_channels, usable_gaussians


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_one_bad_number_makes_a_gaussian_unusable(value):
    quats, means, opacities, coeffs = torch.ones(5, 4), torch.ones(5, 3), torch.ones(5), torch.ones(5, 16, 3)
    for index, tensor in enumerate((quats, means, opacities, coeffs)):
        tensor.view(5, -1)[index, -1] = value
    assert usable_gaussians(quats, means, opacities, coeffs).tolist() == [False] * 4 + [True]
    assert usable_gaussians(torch.ones(5, 4), torch.zeros(5, 0)).all()
    assert usable_gaussians(torch.ones(0, 4), torch.zeros(0, 16, 3)).shape == (0,)


def test_a_quaternion_of_length_zero_makes_a_gaussian_unusable():
    quats = torch.tensor([[0.0, 0, 0, 0], [1e30, 0, 0, 0], [1e-15, 0, 0, 0]])
    assert usable_gaussians(quats).tolist() == [False, False, True]


def test_camera_centers_invert_the_view_matrices():
    poses = make_pose(
        Rotation.random(6, rng=np.random.default_rng(0)).as_matrix(), np.arange(18.0).reshape(6, 3)
    )
    centers = camera_centers(torch.from_numpy(invert(poses)))
    np.testing.assert_allclose(centers.numpy(), poses[:, :3, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [("RGB", [1, 2, 3]), ("D", [4]), ("ED", [4]), ("RGB+D", [1, 2, 3, 4]), ("RGB+ED", [1, 2, 3, 4])],
)
def test_channels_are_colors_features_depth(mode, expected):
    colors, features, depths = torch.tensor([[1.0, 2.0]]), torch.tensor([[3.0]]), torch.tensor([4.0])
    assert stack_channels(colors, features, depths, mode).tolist() == [expected]
    per_camera = stack_channels(colors.expand(5, 1, 2), features, depths.expand(5, 1), mode)
    assert per_camera.tolist() == [[expected]] * 5


def test_finish_blends_the_background_and_divides_the_depth():
    composited = torch.tensor([0.5, 6.0]).expand(1, 1, 2, 2)
    alpha = torch.tensor([0.75, 0.0]).reshape(1, 1, 2, 1)
    background = torch.tensor([[2.0]])
    assert finish(composited, alpha, background, "RGB+D").flatten().tolist() == [1.0, 6.0, 2.5, 6.0]
    assert finish(composited, alpha, None, "RGB+ED")[0, 0, 0].tolist() == [0.5, 8.0]
    assert finish(composited[..., 1:], alpha, background, "D").flatten().tolist() == [6.0, 6.0]
    nothing = finish(torch.zeros(1, 1, 1, 1), torch.zeros(1, 1, 1, 1), None, "ED")
    assert nothing.item() == 0.0
