"""Median depths of pixels: of both rasterizers alike, and by hand."""

import numpy as np
import pytest
import torch

from egosplat.gaussians.render import view_of
from egosplat.geometry import Camera
from egosplat.rasterize.view import pixel_lists
from egosplat_rivals.surface import median_depths
from tests.support.gaussian_scene import SETTINGS
from tests.support.splats import blobs, crowd
from tests.unit.language.test_centers import settings

CAMERA = Camera(60, 40, 50.0, 50.0, 30.0, 20.0)


def test_both_rasterizers_have_the_same_median_depths():
    gaussians, pixels = crowd(), torch.cartesian_prod(torch.arange(0, 60, 7), torch.arange(0, 40, 6))
    views = [view_of(gaussians, CAMERA, np.eye(4), settings(backend)) for backend in ("cpu", "reference")]
    depth = gaussians.means[:, 2].double()
    medians = [median_depths(*pixel_lists(view, pixels), depth) for view in views]
    assert 5 < int(medians[0].isnan().sum()) < len(pixels) - 5
    torch.testing.assert_close(*medians, equal_nan=True)


@pytest.mark.parametrize(
    ("depths", "opacities", "median"),
    [
        # Opacity 0.4 leaves a transmittance of 0.6, and 0.9 behind it leaves 0.06: the second is the median.
        ([2.0, 3.0], [0.4, 0.9], 3.0),
        ([2.0], [0.4], np.nan),
        ([2.0, 2.1, 2.2, 3.0], [0.995] * 3 + [0.9], 2.0),
    ],
)
def test_the_median_depth_of_blobs_in_a_row(depths, opacities, median):
    row = blobs([[0.0, 0.0, depth] for depth in depths], opacities)
    lists = pixel_lists(view_of(row, CAMERA, np.eye(4), SETTINGS), torch.tensor([[30, 20]]))
    np.testing.assert_allclose(median_depths(*lists, torch.tensor(depths).double()), [median], rtol=1e-6)
