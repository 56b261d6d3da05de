"""A camera that stands still is told from one that moves, before COLMAP starts."""

from contextlib import nullcontext

import cv2
import numpy as np
import pycolmap
import pytest

from egosplat.calibration.colmap.database import Project
from egosplat.calibration.colmap.movement import check_camera_moves
from egosplat.errors import UserError

RNG = np.random.default_rng(0)
HAND = RNG.integers(0, 256, (60, 50, 3), dtype=np.uint8)


def tripod(picture, count=12):
    """A picture with noise, before which a textured patch moves."""
    images = []
    for index in range(count):
        noisy = np.clip(picture + RNG.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)
        noisy[60:120, 10 + 9 * index : 60 + 9 * index] = HAND
        images.append(noisy)
    return images


def check(images, folder, shown=None):
    height, width = images[0].shape[:2]
    project = Project(folder, pycolmap.Camera(model="PINHOLE", width=width, height=height))
    project.write_images(images)
    project.write_masks(np.ones((height, width), bool), shown)
    check_camera_moves(project)


def covered(images):
    """Somebody stands before the camera in one of the frames."""
    return [*images[:-1], RNG.integers(0, 256, images[0].shape, dtype=np.uint8)]


@pytest.mark.parametrize("change", [list, covered])
def test_a_tripod_before_which_something_moves_is_told(walk_images, tmp_path, change):
    with pytest.raises(UserError, match=r"stands still: \d+% .* pairs of frames.*\n.*frames.start_s"):
        check(change(tripod(walk_images[0])), tmp_path)


def lettered(images):
    """A camera writes the time into a corner."""
    text = "12:30:15", (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255,) * 3
    return [cv2.putText(image.copy(), *text) for image in images]


def late(images):
    """The camera stands for most of the recording, and moves at its end."""
    return [*tripod(images[0], 16), *images[5:]]


def blank(images):
    """Frames without features are left to COLMAP."""
    return [np.full_like(images[0], 90)] * 5


@pytest.mark.parametrize("change", [list, lettered, late, blank])
def test_a_camera_that_moves_somewhere_is_not_rejected(walk_images, tmp_path, change):
    check(change(walk_images), tmp_path)


def test_what_stays_where_each_picture_leaves_pixels_out_does_not_make_the_camera_stand_still(
    walk_images, tmp_path
):
    """Half of each picture shows the same thing, as on a helmet; masks of the pictures hide it."""
    images = [image.copy() for image in walk_images]
    for image in images:
        image[:, :120] = walk_images[0][:, :120]
    for name, shown in (("all", None), ("masked", np.arange(240) >= np.full((len(images), 180, 1), 120))):
        (tmp_path / name).mkdir()
        with pytest.raises(UserError, match="stands still") if shown is None else nullcontext():
            check(images, tmp_path / name, shown)
