"""In each frame, a Gaussian belongs with all its weight to the mask at the pixel of its center."""

import numpy as np
import pytest
import torch

from egosplat.gaussians.render import view_of
from egosplat.geometry import Camera
from egosplat.instances.lifted_masks import LiftedMasks, lift_masks
from egosplat.rasterize.view import composite
from tests.support.blobs import blobs
from tests.unit.conftest import RENDERING

CAMERA = Camera(32, 24, 30.0, 30.0, 16.0, 12.0)
LEFT, RIGHT, WHOLE = 3, 5, 9

# Left of the border, and half of it on the right; on the right; on the right behind an opaque one; out of view.
WALL = blobs([[-0.03, 0, 2], [0.6, 0, 2], [0.9, 0, 4], [9, 0, 2]], [0.9, 0.999, 0.5, 0.9], size=0.2)


def lifted(counted: np.ndarray | None = None) -> LiftedMasks:
    labels = np.full((2, 24, 32), WHOLE, np.int32)
    labels[0, :, :16], labels[0, :, 16:] = LEFT, RIGHT
    counts = np.ones((24, 32), bool) if counted is None else counted
    return lift_masks(WALL, lambda _: (labels, counts), np.array([7]), np.eye(4)[None], CAMERA, RENDERING)


def weights() -> np.ndarray:
    """(4,) summed compositing weights of the Gaussians."""
    return composite(view_of(WALL, CAMERA, np.eye(4), RENDERING), torch.eye(4))[0].sum(dim=(0, 1)).numpy()


def test_all_weight_goes_to_the_mask_at_the_center():
    found = lifted()
    assert found.row.tolist() == [7] and found.frame.tolist() == [0, 0, 0]
    assert found.instance.tolist() == [LEFT, RIGHT, WHOLE]
    votes, total = found.votes.toarray(), weights()
    np.testing.assert_allclose(votes[0], [total[0], 0, total[0]], rtol=1e-5)
    np.testing.assert_allclose(votes[1], [0, total[1], total[1]], rtol=1e-5)
    np.testing.assert_allclose(found.seen_at(0)[:2], total[:2], rtol=1e-5)


def test_what_a_surface_hides_at_its_center_is_not_seen():
    """Its edge may be visible; what is there says nothing about the pixel of its center."""
    hidden = blobs([[0, 0, 4], [0, 0, 2], [0, 0, 2.1]], [0.9, 0.9999, 0.9999], size=0.3)
    labels = np.full((1, 24, 32), LEFT, np.int32)
    look = lambda _: (labels, np.ones((24, 32), bool))
    found = lift_masks(hidden, look, np.array([0]), np.eye(4)[None], CAMERA, RENDERING)
    image, _ = composite(view_of(hidden, CAMERA, np.eye(4), RENDERING), torch.eye(3))
    assert float(image[..., 0].sum()) > 0.05
    assert found.seen[0, 0] == 0 and found.seen[0, 1] > 1
    assert found.votes.toarray()[0].tolist() == [0]


@pytest.mark.parametrize("column", [15, 16])
def test_pixels_that_do_not_count_neither_vote_nor_show(column):
    """The first Gaussian's center is in column 15."""
    counted = np.ones((24, 32), bool)
    counted[:, column] = False
    found = lifted(counted)
    shown = column != 15
    assert bool(found.seen[0, 0] > 0) == shown and bool(found.votes.toarray()[0].any()) == shown
    assert found.seen[0, 0] < weights()[0]
