"""Views at another size than the frames."""

import numpy as np
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians.training_views import read_views


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


def test_a_reduced_pixel_is_masked_if_a_part_of_it_is(scene):
    masked = np.zeros((6, 32, 32), bool)
    masked[2, 5, 7] = True
    folder = scene(masked=masked)
    frames, poses = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    views = read_views(frames, poses, np.arange(6) >= 1, torch.device("cpu"), resolution=16)
    assert np.argwhere(views.transient.numpy()).tolist() == [[1, 2, 3]]
    assert float(views.weight(1).sum()) == 255.0 and float(views.weight(0).min()) == 1.0
