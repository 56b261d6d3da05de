"""Views come from training frames, are large enough and limited in number; their crops are upright."""

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES
from egosplat.features.crops import cut_crops, find_views, spread
from egosplat.models.clip import Preprocessing

WANTED = Preprocessing((11, 11), (0.5, 0.5, 0.5), (0.2, 0.2, 0.2), "bicubic")

ALL = [range(5)]


def artifacts(folder):
    return open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "instances.zarr", INSTANCES)


def test_rows_go_by_instance_then_frame_and_leave_held_out_frames_out(scene):
    views = find_views(*artifacts(scene()), min_area=0.0, max_views=None, chunks=ALL)
    rows = list(zip(views.instance.tolist(), views.frame.tolist(), views.area.tolist(), strict=True))
    first = [(0, frame, 77) for frame in range(4)]
    assert rows == [*first, *((1, frame, 450) for frame in range(4)), (2, 2, 24), (3, 3, 1)]
    assert views.box[1].tolist() == [3, 2, 14, 9] and views.box[-1].tolist() == [5, 5, 6, 6]
    assert [arr.dtype for arr in (views.instance, views.frame, views.area, views.box)] == [np.int32] * 4


@pytest.mark.parametrize("min_area, instances", [(24 / 1600, {0, 1, 2}), (25 / 1600, {0, 1}), (1.0, set())])
def test_small_masks_are_left_out(scene, min_area, instances):
    views = find_views(*artifacts(scene()), min_area, None, ALL)
    assert set(views.instance.tolist()) == instances and views.box.shape == (len(views), 4)


def test_views_are_limited_to_max_views(scene):
    views = find_views(*artifacts(scene()), 0.0, 2, ALL)
    assert views.instance.tolist() == [0, 0, 1, 1, 2, 3] and views.frame.tolist() == [0, 2, 0, 2, 2, 3]


@pytest.mark.parametrize("most", [1, 2, 3, 7, 10, 1000])
def test_views_are_spread_evenly(most):
    counts = np.array([1, 9, 100, 3])
    kept = spread(np.repeat(np.array([0, 2, 3, 9], np.int32), counts), most)
    for number, part in enumerate(np.split(kept, np.cumsum(counts)[:-1])):
        assert part.sum() == min(counts[number], most) and part[0]
        gaps = np.diff(np.flatnonzero(part))
        assert not len(gaps) or gaps.max() - gaps.min() <= 1


def test_without_training_frames_there_are_no_views(scene):
    views = find_views(*artifacts(scene(train=np.zeros(5, bool))), 0.0, None, ALL)
    assert len(views) == 0 and views.box.shape == (0, 4)


@pytest.mark.parametrize(
    "facts, turned",
    [
        ({"format": "adt", "upright": True}, False),
        ({"format": "adt", "upright": False}, True),
        ({"format": "plain", "upright": False}, False),
    ],
)
def test_crops_are_upright(scene, facts, turned):
    frames, instances = artifacts(scene(**facts))
    views = find_views(frames, instances, 0.0, None, ALL)
    views = views.chosen(views.by_frame)
    crops = list(cut_crops(frames, instances, views, WANTED, hull=False))
    assert len(crops) == len(views)
    expected = np.zeros((11, 11, 3), np.uint8)
    expected[2:9] = frames.row("rgb", 0)[2:9, :11]
    np.testing.assert_array_equal(crops[0], np.rot90(expected, -1) if turned else expected)


def test_each_frame_is_read_once(scene, monkeypatch):
    frames, instances = artifacts(scene())
    views = find_views(frames, instances, 0.0, None, ALL)
    read = []
    row = type(frames).row
    monkeypatch.setattr(
        type(frames), "row", lambda self, name, at: read.append((name, int(at))) or row(self, name, at)
    )
    list(cut_crops(frames, instances, views.chosen(views.by_frame), WANTED, hull=False))
    assert sorted(read) == sorted((name, frame) for name in ("rgb", "labels") for frame in range(4))
