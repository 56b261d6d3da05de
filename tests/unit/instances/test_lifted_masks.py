"""A Gaussian belongs with all its weight to the mask at the pixel of its center; things are drawn where their Gaussians are."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy import sparse

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import view_of
from egosplat.geometry import Camera
from egosplat.instances.lifted_masks import LiftedMasks, lift
from egosplat.instances.rendering import LEAST_BELIEF, render_things
from egosplat.instances.scene import first_of_largest
from egosplat.rasterize.view import composite
from tests.support.gaussian_scene import SETTINGS
from tests.support.splats import blobs

CAMERA = Camera(32, 24, 30.0, 30.0, 16.0, 12.0)
LEFT, RIGHT, WHOLE = 3, 5, 9

# Left of the border, and half of it on the right; on the right; on the right behind an opaque one; out of view.
WALL = blobs([[-0.03, 0, 2], [0.6, 0, 2], [0.9, 0, 4], [9, 0, 2]], [0.9, 0.999, 0.5, 0.9], size=0.2)


def geometry_of(gaussians: Gaussians, frame: int) -> SimpleNamespace:
    """Gaussians and one view of them."""
    views = SimpleNamespace(frame=np.array([frame]), camera_to_world=np.eye(4)[None], camera=CAMERA)
    return SimpleNamespace(gaussians=gaussians, views=views, settings=SETTINGS)


def lifted(counted: np.ndarray | None = None) -> LiftedMasks:
    labels = np.full((2, 24, 32), WHOLE, np.int32)
    labels[0, :, :16], labels[0, :, 16:] = LEFT, RIGHT
    counts = np.ones((24, 32), bool) if counted is None else counted
    segments = SimpleNamespace(row=lambda *_: labels)
    return lift(geometry_of(WALL, 7), segments, lambda _: counts, lambda given: (given, ~counts))


def weights() -> np.ndarray:
    """(4,) summed compositing weights of the Gaussians."""
    return composite(view_of(WALL, CAMERA, np.eye(4), SETTINGS), torch.eye(4))[0].sum(dim=(0, 1)).numpy()


def test_all_weight_goes_to_the_mask_at_the_center():
    found = lifted()
    assert [*found.row, *found.frame, *found.instance] == [7, 0, 0, 0, LEFT, RIGHT, WHOLE]
    votes, total = found.votes.toarray(), weights()
    np.testing.assert_allclose(votes[:2], total[:2, None] * [[1, 0, 1], [0, 1, 1]], rtol=1e-5)
    np.testing.assert_allclose(found.seen.toarray()[0, :2], total[:2], rtol=1e-5)


def test_what_a_surface_hides_at_its_center_is_not_seen():
    """Its edge may be visible; what is there says nothing about the pixel of its center."""
    hidden = blobs([[0, 0, 4], [0, 0, 2], [0, 0, 2.1]], [0.9, 0.9999, 0.9999], size=0.3)
    labels, shown = np.full((1, 24, 32), LEFT, np.int32), np.ones((24, 32), bool)
    segments = SimpleNamespace(row=lambda *_: labels)
    found = lift(geometry_of(hidden, 0), segments, lambda _: shown, lambda given: (given, ~shown))
    image, _ = composite(view_of(hidden, CAMERA, np.eye(4), SETTINGS), torch.eye(3))
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


COUNT, THINGS, SIZE = 400, 150, (24, 32)
SMALL = Camera(width=16, height=12, fx=10.0, fy=10.0, cx=8.0, cy=6.0)


def scene() -> tuple[Gaussians, list[sparse.csr_array]]:
    """Gaussians all around the camera, and things of two levels that hold a few of them each."""
    noise = torch.Generator().manual_seed(0)
    means, opacities = (
        4.0 * torch.rand(COUNT, 3, generator=noise) - 2.0,
        torch.randn(COUNT, generator=noise).sigmoid(),
    )
    gaussians = blobs(means.tolist(), opacities.tolist(), size=0.135)
    held = [
        sparse.random_array((COUNT, things), density=0.02, rng=level, dtype=np.float32).tocsr()
        for level, things in enumerate((THINGS, THINGS // 2))
    ]
    return gaussians, held


def expected(gaussians: Gaussians, held: sparse.csr_array, pose: np.ndarray, size: tuple) -> np.ndarray:
    """The strongest thing of each pixel, from one image of all things."""
    image, _ = composite(view_of(gaussians, SMALL, pose, SETTINGS), torch.from_numpy(held.toarray()))
    large = torch.nn.functional.interpolate(image.permute(2, 0, 1)[None], size, mode="bilinear")[0]
    highest, which = large.max(0)
    return torch.where(highest > LEAST_BELIEF, which, -1).numpy()


@pytest.mark.parametrize("size", [SIZE, (18, 24), (13, 17), (9, 12), (12, 16)])
def test_things_are_drawn_as_if_all_were_rendered_at_once(size):
    """Also where a cell is no whole number of pixels, and where pixels are larger than cells."""
    gaussians, held = scene()
    for turn in (0.0, 2.0):
        pose = np.eye(4)
        pose[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        found = render_things(gaussians, held, SMALL, pose, SETTINGS, size)
        assert found.shape == (2, *size) and found.dtype == np.int32
        for level, labels in enumerate(found):
            assert np.array_equal(labels, expected(gaussians, held[level], pose, size))
            assert len(np.unique(labels)) > 10


def test_a_level_without_things_and_a_view_of_nothing_have_no_label():
    gaussians, held = scene()
    far = np.eye(4)
    far[2, 3] = 100.0
    nothing = sparse.csr_array((COUNT, 0), dtype=np.float32)
    assert (render_things(gaussians, [held[0], nothing], SMALL, far, SETTINGS, SIZE) == -1).all()
    assert (render_things(gaussians, [nothing], SMALL, np.eye(4), SETTINGS, SIZE) == -1).all()


def test_the_largest_value_of_a_sparse_row_is_that_of_the_dense_row():
    rng = np.random.default_rng(0)
    dense = rng.integers(-1, 4, (200, 7)) * (rng.random((200, 7)) < 0.4)
    dense[0] = 0.0
    found = first_of_largest(sparse.csr_array(dense.astype(np.float32)))
    assert np.array_equal(found, np.where(dense.max(1) > 0, dense.argmax(1), -1)) and found[0] == -1
    assert first_of_largest(sparse.csr_array((3, 0), dtype=np.float32)).tolist() == [-1, -1, -1]
