"""Frames with a pose get one role each, and views hold the chosen frames, long recordings not all at once."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians import training_views as module
from egosplat.gaussians.training_views import StoredRows, read_views, split_views
from egosplat.geometry import Camera

CPU = torch.device("cpu")


def mask(count: int, *rows: int) -> np.ndarray:
    return np.isin(np.arange(count), rows)


def opened(folder):
    return open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)


def test_only_frames_with_a_pose_are_used_and_evaluated_frames_are_not_trained_on():
    flags = {"train": mask(6, 0, 1, 2, 5), "evaluation": mask(6, 3, 4, 5), "registered": mask(6, 0, 2, 3, 5)}
    read = SimpleNamespace(read=flags.__getitem__)
    training, held_out = split_views(read, read)
    assert np.flatnonzero(training).tolist() == [0, 2, 5]
    assert np.flatnonzero(held_out).tolist() == [3]  # 4 has no pose, 5 is trained on
    training, held_out = split_views(read, read, mask(6, 0, 1))
    assert np.flatnonzero(training).tolist() == [0] and np.flatnonzero(held_out).tolist() == [3, 5]


def test_views_are_the_chosen_frames(scene, pictures, camera_to_world):
    intrinsics = Camera(24, 24, 30.0, 31.0, 11.0, 13.0).matrix
    views = read_views(*opened(scene(intrinsics=intrinsics)), mask(9, 1, 7), CPU)
    assert len(views) == 2 and views.frame.tolist() == [1, 7]
    np.testing.assert_array_equal([views.pictures[0], views.pictures[1]], pictures[[1, 7]])
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


@pytest.mark.parametrize("kept", [0, 2, 5])
def test_rows_are_read_once_while_there_is_room_and_equal_whether_they_are_kept_or_not(monkeypatch, kept):
    array = np.random.default_rng(0).integers(256, size=(5, 4, 3), dtype=np.uint8)
    monkeypatch.setattr(module, "IN_MEMORY", kept * 12)
    asked: list[int] = []

    def read(position: int) -> np.ndarray:
        asked.append(position)
        return array[position]

    rows = StoredRows(read)
    for position in (*range(5), *range(5)):
        assert torch.equal(rows[position], torch.from_numpy(array[position]))
    assert asked == [*range(5), *range(kept, 5)]
