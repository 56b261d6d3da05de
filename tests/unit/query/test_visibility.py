"""The share of a view that each Gaussian fills is the sum of its compositing weights."""

import numpy as np
import pytest
import torch

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.query.scene_query import visible_shares
from egosplat.rasterize.view import composite

CAMERA = Camera(20, 16, 18.0, 18.0, 10.0, 8.0)
SETTINGS = RenderSettings(near_plane=0.1, background="black", antialiased=False, backend="cpu")


@pytest.fixture
def cloud() -> Gaussians:
    """A translucent Gaussian in front of an opaque one, one aside, one behind the camera."""
    means = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.6, 0.0, 2.0], [0.0, 0.0, -2.0]])
    return Gaussians(
        means=means,
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(4, 1),
        log_scales=torch.full((4, 3), np.log(0.2)),
        logit_opacities=torch.tensor([0.0, 4.0, 4.0, 4.0]),
        sh=torch.zeros(4, 1, 3),
        features=torch.zeros(4, 0),
    )


def window() -> np.ndarray:
    """The share of the picture that each pixel counts as, written out."""
    rows, columns = np.sin(np.pi * (np.arange(16) + 0.5) / 16), np.sin(np.pi * (np.arange(20) + 0.5) / 20)
    return rows[:, None] * columns / (rows.sum() * columns.sum())


def test_shares_are_sums_of_compositing_weights(cloud):
    """Each Gaussian rendered alone in white, behind what hides it, gives the same sum."""
    (shares,) = visible_shares(cloud, CAMERA, [np.eye(4)], None, SETTINGS)
    weights, _ = composite(view_of(cloud, CAMERA, np.eye(4), SETTINGS), torch.eye(4))
    expected = (weights.numpy() * window()[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(shares.numpy(), expected, rtol=1e-4, atol=1e-7)
    assert shares[3] == 0.0 and 0 < shares.sum() <= 1.0


def test_invalid_pixels_show_nothing(cloud):
    """A lens circle that leaves out the right half hides what is there."""
    valid = np.ones((16, 20), bool)
    valid[:, 10:] = False
    (everything,) = visible_shares(cloud, CAMERA, [np.eye(4)], None, SETTINGS)
    (half,) = visible_shares(cloud, CAMERA, [np.eye(4)], valid, SETTINGS)
    assert half[2] < 0.1 * everything[2] and half[0] > 0.3 * everything[0]


def test_one_row_a_view(cloud):
    """A view from behind sees the Gaussian that the first one does not."""
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    shares = visible_shares(cloud, CAMERA, [np.eye(4), behind], None, SETTINGS)
    assert shares.shape == (2, 4) and shares[1, 3] > 0 and (shares[1, :3] == 0).all()
    assert visible_shares(cloud, CAMERA, [], None, SETTINGS).shape == (0, 4)
