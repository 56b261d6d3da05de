"""Motion detection between two images of a wall and a board, and over a whole recording."""

import cv2
import numpy as np
import pytest

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.survey.motion import (
    Motion,
    choose_pairs,
    detect_motion,
    is_static,
    large_regions,
    measure_motion,
)

SECOND = 1_000_000_000

STEPS = {
    "sideways": {"x": 0.15},
    "ahead": {"z": 0.3},
    "turning": {"yaw": 12.0, "pitch": 4.0},
    "both": {"x": 0.1, "z": 0.1, "yaw": 8.0},
    "not at all": {},
}


@pytest.fixture
def between(room):
    """``between(first, second, pose)``: motion between images from the origin and from a pose."""

    def find(first: np.ndarray, second: np.ndarray, there: np.ndarray, valid: np.ndarray | None = None):
        valid = np.ones(first.shape, bool) if valid is None else valid
        return detect_motion(first, second, valid, room.camera.matrix, (room.pose(), there), room.board / 2)

    return find


@pytest.fixture
def moved(room, between):
    """``moved(step, before, after)``: motion between images a camera step apart, with the object at two places."""

    def find(step: dict, before: tuple | None = None, after: tuple | None = None, textured: bool = True):
        there = room.pose(**step)
        return between(room.image(room.pose(), before, textured), room.image(there, after, textured), there)

    return find


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
def test_camera_motion_alone_is_not_motion(moved, step):
    found = moved(step)
    assert found.measured.mean() > 0.4 and not found.moving.any()


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
def test_a_moving_object_is_found_at_its_place(moved, step):
    found = moved(step, (0.1, -0.3), (0.1, -0.25))
    rows, columns = np.nonzero(found.moving)
    # Its corner is at (88, 56); its side is 40 pixels.
    assert len(rows) > 0.5 * 40**2
    assert (columns > 80).all() and (columns < 136).all() and (rows > 48).all() and (rows < 108).all()


def test_a_static_object_is_not_motion(moved):
    assert not moved(STEPS["both"], (0.1, -0.3), (0.1, -0.3)).moving.any()


def test_motion_of_the_whole_image_is_found(room, between):
    """The camera stands still by its poses, and every pixel moves down."""
    seen = room.image(room.pose())
    found = between(seen, np.roll(seen, 6, axis=0), room.pose())
    assert found.moving.sum() > 0.9 * found.measured.sum() > 0.3 * seen.size


def test_untextured_frames_show_no_motion(moved):
    assert not moved(STEPS["both"], textured=False).moving.any()


def test_motion_outside_the_lens_circle_is_ignored(room, between):
    there = room.pose(**STEPS["turning"])
    circle = cv2.circle(np.zeros((room.size, room.size), np.uint8), (80, 80), 50, 1, -1) > 0
    images = [np.where(circle, room.image(pose), 0).astype(np.uint8) for pose in (room.pose(), there)]
    found = between(*images, there, circle)
    assert not found.moving.any() and found.measured.any() and not (found.measured & ~circle).any()
    nothing = between(*images, there, np.zeros_like(circle))
    assert not nothing.measured.any() and not nothing.moving.any()


def test_tiny_images_have_no_motion(room, between):
    tiny = np.zeros((20, 17), np.uint8)
    found = between(tiny, tiny, room.pose())
    assert found.moving.shape == (20, 17) and not found.moving.any()


def test_small_and_narrow_regions_are_removed():
    mask = np.zeros((160, 160), bool)
    mask[10, 10], mask[40:44, 20:140] = True, True
    assert not large_regions(mask).any()
    mask[80:100, 80:100] = True
    found = large_regions(mask)
    assert found[85:95, 85:95].all() and not found[:70].any()


def pairs_of(times_s: list[float], registered: list[bool] | None = None) -> list[list[int]]:
    times = (np.array(times_s, float) * SECOND).astype(np.int64)
    known = np.ones(len(times_s), bool) if registered is None else np.array(registered)
    return choose_pairs(times, known).tolist()


def test_pairs_are_a_fifth_of_a_second_apart():
    assert pairs_of([0, 0.2, 0.4]) == [[0, 1], [1, 2]]
    assert pairs_of(list(np.arange(9) / 30)) == [[0, 6], [1, 7], [2, 8]]
    assert pairs_of([0, 0.5, 1.0]) == [[0, 1], [1, 2]]


def test_no_pair_over_a_long_gap_or_without_a_pose():
    assert pairs_of([0, 5.0, 5.2]) == [[1, 2]]
    assert pairs_of([0, 0.2, 0.4], [True, False, True]) == [[0, 2]]
    assert pairs_of([0, 0.2], [True, False]) == pairs_of([0]) == pairs_of([]) == []


def test_pairs_of_a_long_recording_are_spread_in_time():
    found = np.array(pairs_of(list(np.arange(3000) / 30)))
    assert len(found) == 120 and found[0, 0] < 20 and found[-1, 0] > 2960
    assert np.ptp(np.diff(found[:, 0])) <= 1


def motion(moving: list[float], measured: list[float]) -> Motion:
    unknown = np.full(len(moving), np.nan)
    return Motion(
        np.zeros((len(moving), 2), np.int64), np.array(moving), np.array(measured), unknown, unknown
    )


@pytest.mark.parametrize(
    "found, static",
    [
        (motion([0.0, 0.0], [0.7, 0.7]), True),
        (motion([0.0009, 0.0], [0.7, 0.7]), True),
        (motion([0.0011, 0.0], [0.7, 0.7]), False),
        (motion([0.0, 0.0], [0.1, 0.1]), False),  # too little is measured
        (motion([0.0], [0.7]), False),
        (motion([], []), False),
    ],
)
def test_a_scene_is_static_only_if_enough_is_measured(found, static):
    assert is_static(found, 0.0005) is static


def test_the_threshold_decides_whether_a_scene_is_static():
    assert is_static(motion([0.02, 0.02], [0.7, 0.7]), 1.0)
    assert not is_static(motion([0.0, 0.0], [0.7, 0.7]), 0.0)


@pytest.mark.parametrize("step, moves", [(0.0, False), (0.05, True)])
def test_a_recording_moves_where_an_object_does(room, scene, step, moves):
    trajectory = [room.pose(x=0.08 * frame, yaw=3.0 * frame) for frame in range(5)]
    folder = scene(
        trajectory, [room.image(pose, (0.2, -0.4 + step * k)) for k, pose in enumerate(trajectory)]
    )
    found = measure_motion(
        open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    )
    assert found.pairs.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert found.measured.min() > 0.3 and (found.share > 0.005 if moves else found.share == 0)
