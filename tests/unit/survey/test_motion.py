"""What moves between two pictures of a wall and a board, and what only seems to."""

import cv2
import numpy as np
import pytest

from egosplat.survey.motion import blobs, find_moving

WALKS = {
    "sideways": {"x": 0.15},
    "ahead": {"z": 0.3},
    "turning": {"yaw": 12.0, "pitch": 4.0},
    "both": {"x": 0.1, "z": 0.1, "yaw": 8.0},
    "not at all": {},
}


@pytest.fixture
def between(room):
    """``between(first, second, there)``: what moves between two pictures, from the origin and from a pose."""

    def find(first: np.ndarray, second: np.ndarray, there: np.ndarray, valid: np.ndarray | None = None):
        valid = np.ones(first.shape, bool) if valid is None else valid
        return find_moving(first, second, valid, room.camera.matrix, (room.pose(), there), room.board / 2)

    return find


@pytest.fixture
def moved(room, between):
    """``moved(walk, before, after)``: the same of pictures of the room with the thing at two places."""

    def find(walk: dict, before: tuple | None = None, after: tuple | None = None, textured: bool = True):
        there = room.pose(**walk)
        return between(
            room.picture(room.pose(), before, textured), room.picture(there, after, textured), there
        )

    return find


@pytest.mark.parametrize("walk", WALKS.values(), ids=WALKS)
def test_camera_motion_alone_is_not_motion(moved, walk):
    found = moved(walk)
    assert found.measured.mean() > 0.4 and not found.moving.any()


@pytest.mark.parametrize("walk", WALKS.values(), ids=WALKS)
def test_a_thing_that_moves_is_found_where_it_is(moved, walk):
    found = moved(walk, (0.1, -0.3), (0.1, -0.25))
    rows, columns = np.nonzero(found.moving)
    # Its corner is at (88, 56); its side is 40 pixels.
    assert len(rows) > 0.5 * 40**2
    assert (columns > 80).all() and (columns < 136).all() and (rows > 48).all() and (rows < 108).all()


def test_a_static_thing_is_not_motion(moved):
    assert not moved(WALKS["both"], (0.1, -0.3), (0.1, -0.3)).moving.any()


def test_everything_moves(room, between):
    """The poses say that the camera stands; every pixel goes down."""
    seen = room.picture(room.pose())
    found = between(seen, np.roll(seen, 6, axis=0), room.pose())
    assert found.moving.sum() > 0.9 * found.measured.sum() > 0.3 * seen.size


def test_untextured_frames_show_no_motion(moved):
    assert not moved(WALKS["both"], textured=False).moving.any()


def test_motion_outside_the_lens_circle_is_ignored(room, between):
    there = room.pose(**WALKS["turning"])
    circle = cv2.circle(np.zeros((room.size, room.size), np.uint8), (80, 80), 50, 1, -1) > 0
    pictures = [np.where(circle, room.picture(walk), 0).astype(np.uint8) for walk in (room.pose(), there)]
    found = between(*pictures, there, circle)
    assert not found.moving.any() and found.measured.any() and not (found.measured & ~circle).any()
    nothing = between(*pictures, there, np.zeros_like(circle))
    assert not nothing.measured.any() and not nothing.moving.any()


def test_tiny_pictures_are_no_error(room, between):
    tiny = np.zeros((20, 17), np.uint8)
    found = between(tiny, tiny, room.pose())
    assert found.moving.shape == (20, 17) and not found.moving.any()


def test_small_and_thin_blobs_are_dropped():
    mask = np.zeros((160, 160), bool)
    mask[10, 10], mask[40:44, 20:140] = True, True
    assert not blobs(mask).any()
    mask[80:100, 80:100] = True
    found = blobs(mask)
    assert found[85:95, 85:95].all() and not found[:70].any()
