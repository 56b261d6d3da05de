"""Frames that add views are kept, and frames with an unknown view."""

import numpy as np
import pytest

from egosplat.geometry import Camera
from egosplat.survey.views import choose_views, depth_quantile, median_depths, view_change
from tests.unit.survey.conftest import pose

CAMERA = Camera(100, 100, 50.0, 50.0, 50.0, 50.0)


def kept(trajectory: list[np.ndarray], least: float = 5.0, **changes: object) -> list[int]:
    """Of a recording with 30 frames per second."""
    count = len(trajectory)
    given = {
        "camera_to_world": np.stack(trajectory),
        "depths": np.full(count, 2.0),
        "times_ns": (np.arange(count) / 30 * 1e9).astype(np.int64),
        "optional": np.ones(count, bool),
    } | changes
    return np.flatnonzero(choose_views(**given, min_change_deg=least)).tolist()


def test_rotation_and_parallax_add_up():
    assert view_change(pose(), pose(yaw=4.0), 2.0) == pytest.approx(4.0)
    assert view_change(pose(), pose(x=2.0), 2.0) == pytest.approx(45.0)
    assert view_change(pose(), pose(x=2.0, yaw=4.0), 2.0) == pytest.approx(49.0)
    assert view_change(pose(), pose(x=2.0), np.inf) == 0.0
    assert view_change(pose(yaw=33.0), pose(yaw=33.0), 2.0) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("trajectory", "changes", "expected"),
    [
        # Small changes accumulate.
        ([pose(yaw=2.0 * k) for k in range(8)], {}, [0, 3, 6, 7]),
        ([pose(x=0.1 * k) for k in range(8)], {}, [0, 2, 4, 6, 7]),
        ([pose(yaw=6.0 * k) for k in range(8)], {}, [*range(8)]),
        ([pose()] * 8, {"least": 0.0}, [*range(8)]),
        # A still camera keeps one frame per second.
        ([pose()] * 65, {}, [0, 30, 60, 64]),
        ([pose()], {}, [0]),
        ([pose()] * 2, {}, [0, 1]),
        # Evaluation frames are kept and not compared.
        ([pose()] * 6, {"optional": np.array([True, False, False, True, True, True])}, [0, 1, 2, 5]),
        # Frames without a pose or depth are kept.
        (
            [pose()] * 3 + [np.full((4, 4), np.nan)] + [pose()] * 2,
            {"depths": np.array([2.0, 2.0, 2.0, np.nan, 2.0, 2.0])},
            [0, 3, 5],
        ),
        ([pose()] * 6, {"depths": np.full(6, np.nan)}, [*range(6)]),
    ],
)
def test_views_that_are_new_are_kept(trajectory, changes, expected):
    assert kept(trajectory, **changes) == expected


def test_depths_are_those_of_points_inside_the_image_or_of_a_sample_of_many():
    points = np.array([[0.0, 0.0, z] for z in np.linspace(1, 3, 21)] + [[0.0, 0.0, -1.0], [9.0, 0.0, 1.0]])
    assert depth_quantile(CAMERA, np.eye(4), points, 0.5) == pytest.approx(2.0)
    assert np.isnan(depth_quantile(CAMERA, np.eye(4), points[:5], 0.5))
    trajectory = np.stack([pose(), pose(yaw=180.0), pose(z=-1.0)])
    found = median_depths(CAMERA, trajectory, np.array([True, True, False]), points)
    assert found[0] == pytest.approx(2.0) and np.isnan(found[1:]).all()
    many = np.linspace(1, 5, 120_000)[:, None] * [0, 0, 1]
    assert depth_quantile(CAMERA, np.eye(4), many, 0.5) == pytest.approx(3.0, abs=1e-3)
