"""Frames at working size keep their aspect ratio and content."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.gaussians.reduced_views import reduced, working_size
from egosplat.gaussians.training_views import read_views


@pytest.mark.parametrize(
    ("resolution", "size"), [(1000, (48, 64)), (64, (48, 64)), (32, (24, 32)), (1, (1, 1))]
)
def test_the_longer_side_is_the_resolution_and_never_grows(resolution, size):
    assert working_size(48, 64, resolution) == size


def test_areas_are_averaged():
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:2, 0] = 200
    assert reduced(picture, 2, 2)[..., 0].tolist() == [[100, 0], [0, 0]]
    assert reduced(picture, 4, 4) is picture


def test_resizing_views_keeps_their_content(scene):
    valid = np.ones((32, 32), bool)
    valid[0, 0] = False
    folder = scene(valid=valid)
    frames, poses = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    cpu = torch.device("cpu")
    views = read_views(frames, poses, np.arange(6) == 2, cpu, resolution=16)
    assert views.frame.tolist() == [2] and views.pictures.shape == (1, 16, 16, 3)
    assert (views.camera.fx, views.camera.cx, views.camera.width) == (15.0, 8.0, 16)
    # A pixel of which a part lies outside the lens circle does not count.
    assert float(views.valid[0, 0]) == 0.0 and float(views.valid.sum()) == 255.0
    assert read_views(frames, poses, np.zeros(6, bool), cpu, resolution=16).pictures.shape[0] == 0
