"""Sightings where the Gaussians show no depth, and of masks that are the picture, or one pixel of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from egosplat.geometry import Camera
from egosplat.histories.moves import find_carries
from egosplat.histories.sightings import see_tracks
from tests.support.scenes import sideways

CAMERA = Camera(96, 72, 60.0, 60.0, 48.0, 36.0)
COUNT = 30


def see(mask: np.ndarray, depth: np.ndarray):
    """A track with a mask, in all frames of a camera that goes to the right by 2 m; and the carries of it."""
    labels = np.where(mask, 0, -1).astype(np.int32)[None]
    recording = SimpleNamespace(
        instances=SimpleNamespace(row=lambda *_: labels),
        depth=lambda _: depth,
        is_track=np.array([True]),
        valid=np.ones(mask.shape, bool),
        camera=CAMERA,
        camera_to_world=sideways(np.linspace(0, 2, COUNT)),
    )
    seen, inside = see_tracks(np.arange(COUNT), recording)
    return seen, find_carries(seen, inside, np.arange(COUNT) / 5)


def box(left: int, top: int, right: int, low: int) -> np.ndarray:
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[top:low, left:right] = True
    return mask


@pytest.mark.numerics("track at depth 0, NaN, infinity, negative", outside="no carry")
@pytest.mark.parametrize("depth", [0.0, np.nan, np.inf, -np.inf, -1.0])
def test_no_depth(depth):
    seen, carries = see(box(40, 30, 56, 42), np.full((18, 24), depth))
    assert not len(seen) and carries == []


@pytest.mark.numerics("place and size of a track with one pixel at depth 1e-6 to 1e9 m", within=1e-12)
def test_depth_of_one_pixel(measured):
    for depth in 10.0 ** np.arange(-6, 10):
        surface = np.full((CAMERA.height, CAMERA.width), np.nan)
        surface[36, 48] = depth
        seen, _ = see(box(40, 30, 56, 42), surface)
        true = np.array([0, 0, depth]) + np.linspace(0, 2, COUNT)[:, None] * [1, 0, 0]
        measured(np.abs(seen.center - true).max() / max(depth, 2))
        measured(abs(seen.side.max() / (np.sqrt(16 * 12) / 60 * depth) - 1))


@pytest.mark.numerics("mask of all pixels, or all but one, camera moving", outside="the wearer's; no carry")
@pytest.mark.parametrize("left_out", [0, 1])
def test_the_whole_picture(left_out):
    mask = box(0, 0, CAMERA.width, CAMERA.height)
    mask[36, 48 : 48 + left_out] = False
    seen, carries = see(mask, np.full((18, 24), 2.0))
    assert len(seen) == COUNT and (seen.box == [0, 0, CAMERA.width, CAMERA.height]).all()
    assert (seen.edge > 0.01).all() and carries == []


@pytest.mark.numerics(
    "mask of one pixel, in the middle and in a corner", outside="at its middle, of a pixel's size"
)
@pytest.mark.parametrize(("column", "row"), [(48, 36), (0, 0), (95, 71)])
def test_one_pixel(column, row):
    seen, _ = see(box(column, row, column + 1, row + 1), np.full((18, 24), 3.0))
    assert len(seen.frame) == COUNT and np.allclose(seen.side, 3 / 60)
    assert np.allclose(seen.local, [(column + 0.5 - 48) / 20, (row + 0.5 - 36) / 20, 3])
