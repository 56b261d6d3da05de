"""The cut of a long recording into cells: each camera is owned once, neighbors overlap, and what cannot be cut is one."""

import numpy as np
import pytest

from egosplat.geometry import ground_axes, rotate
from egosplat.survey.cells import find_cells
from tests.support.scenes import UP, sideways

DEPTH = 2.0


def along(x: np.ndarray, z: np.ndarray | float = 0.0) -> np.ndarray:
    """Poses at places of the ground."""
    poses = sideways(np.asarray(x, float))
    poses[:, 2, 3] = z
    return poses


def cells_of(poses: np.ndarray, most: int, depth: np.ndarray | float = DEPTH, counted=1, up=UP) -> list[dict]:
    every = np.ones(len(poses), bool)
    return find_cells(poses, every * depth, every, np.arange(len(poses)) % counted == 0, up, most)


def owned(cells: list[dict], poses: np.ndarray) -> np.ndarray:
    """(cells, F) bool: which camera lies in which cell."""
    places = poses[:, :3, 3] @ ground_axes(UP).T
    limits = np.array([cell["limits"] for cell in cells])[:, :, None]
    return ((places >= limits[:, 0]) & (places < limits[:, 1])).all(axis=2)


def test_each_camera_is_owned_once_and_cells_hold_about_as_many():
    rng = np.random.default_rng(0)
    poses = along(rng.uniform(0, 40, 1000), rng.uniform(0, 10, 1000))
    cells = cells_of(poses, 150)
    own = owned(cells, poses)
    assert (own.sum(axis=0) == 1).all() and len(cells) == 8
    assert own.sum(axis=1).min() >= 120 and own.sum(axis=1).max() <= 150
    far = along(np.array([-1e6, 1e6]), np.array([1e6, -1e6]))
    assert (owned(cells, far).sum(axis=0) == 1).all(), "outer cells have no border"
    for cell, row in zip(cells, own, strict=True):
        assert {*np.flatnonzero(row)} < {*cell["frames"]}, "neighbors overlap"
    assert len(cells_of(poses, 150, counted=2)) == 4, "frames that add no view count nothing"
    tilted = np.array([0.36, -0.8, 0.48])
    places = np.sort(rotate(ground_axes(tilted), poses[:, :3, 3]), axis=0)
    cuts = {*((places[499] + places[500]) / 2)}
    assert cuts & {*cells_of(poses, 500, up=tilted)[0]["limits"][1]}, "to the bit, on every processor"


def test_a_cell_is_wider_by_a_fifth_and_half_the_depth_of_the_frames_that_see_least_through_walls():
    x = np.arange(0.0, 20.0, 0.1)
    depths = np.where(x < 6, DEPTH, 9.0)
    depths[7] = np.nan
    left, right = sorted(cells_of(along(x), 100, depths), key=lambda cell: max(cell["frames"]))
    assert max(left["margin"]) == pytest.approx(0.2 * 9.9 + 0.5 * DEPTH)
    # The border lies between frames 99 and 100, and the margin is 2.98 m.
    assert left["frames"] == [*range(130)] and right["frames"] == [*range(70, 200)]


@pytest.mark.parametrize(
    ("length", "count", "most"),
    [(0, 50, 10), (1.9, 50, 10), (100, 50, 50), (100, 50, 0), (0, 0, 10)],
    ids=["one place", "narrower than the depth", "few", "switched off", "none"],
)
def test_what_cannot_or_need_not_be_cut_has_no_cells(length, count, most):
    assert cells_of(along(np.linspace(0, length, count)), most) == []


def test_a_line_is_cut_along_it_and_a_camera_that_stands_still_stops_nothing():
    still = along(np.concatenate([np.zeros(80), np.linspace(0.5, 50, 20)]))
    own = owned(cells_of(still, 10), still)
    assert (own.sum(axis=0) == 1).all() and own.sum(axis=1).tolist().count(80) == 1 and len(own) > 2
    assert len(cells_of(along(np.linspace(0, 8, 3)), 1, np.nan)) == 3, (
        "no depth, and fewer cameras than cells"
    )
    still[3, 0, 3] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        cells_of(still, 2)
