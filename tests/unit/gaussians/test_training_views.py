"""Frames with a pose get one role each, and views hold the chosen frames."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.errors import UserError
from egosplat.gaussians.training_views import read_views, split_views
from egosplat.geometry import Camera

CPU = torch.device("cpu")


def mask(count: int, *rows: int) -> np.ndarray:
    return np.isin(np.arange(count), rows)


def opened(folder):
    return open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)


def test_only_frames_with_a_pose_are_used_and_evaluated_frames_are_not_trained_on():
    split = split_views(mask(6, 0, 1, 2, 5), mask(6, 3, 4, 5), mask(6, 0, 2, 3, 5))
    assert np.flatnonzero(split.training).tolist() == [0, 2, 5]
    assert np.flatnonzero(split.held_out).tolist() == [3]  # 4 has no pose, 5 is trained on


def test_too_few_views_are_rejected():
    with pytest.raises(UserError, match="2 training frames"):
        split_views(mask(3, 0, 1), mask(3, 2), mask(3, 2))


def test_views_are_the_chosen_frames(scene, pictures, camera_to_world):
    intrinsics = Camera(24, 24, 30.0, 31.0, 11.0, 13.0).matrix
    views = read_views(*opened(scene(intrinsics=intrinsics)), mask(9, 1, 7), CPU)
    assert len(views) == 2 and views.frame.tolist() == [1, 7]
    np.testing.assert_array_equal(views.pictures.numpy(), pictures[[1, 7]])
    np.testing.assert_array_equal(views.camera_to_world, camera_to_world[[1, 7]])
    # The poses artifact's, which COLMAP may have refined, not that of the frames.
    assert views.camera == Camera(24, 24, 30.0, 31.0, 11.0, 13.0)
    picture = views.picture(1)
    assert picture.dtype == torch.float32 and float(picture.max()) <= 1.0
    np.testing.assert_allclose(picture.numpy(), pictures[7] / 255, atol=1e-7)


def test_the_weight_is_the_lens_circle(scene):
    valid = np.ones((24, 24), bool)
    assert read_views(*opened(scene()), mask(9, 0), CPU).valid is None
    valid[:3, 5] = False
    weight = read_views(*opened(scene(valid=valid)), mask(9, 0), CPU).valid
    assert weight.dtype == torch.float32
    np.testing.assert_array_equal(weight.numpy(), valid)
