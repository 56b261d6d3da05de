"""Views come from training frames, are large enough and limited in number; their crops are upright."""

import numpy as np
import pytest

from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES
from egosplat.features.crops import cut_crops, find_views, spread
from egosplat.models.clip import Preprocessing

WANTED = Preprocessing((11, 11), (0.5, 0.5, 0.5), (0.2, 0.2, 0.2), "bicubic")


def opened(folder, min_area=0.0, max_views=None):
    """The frames, the instances, and the views."""
    frames, instances = (open_artifact(folder / f"{each.name}.zarr", each) for each in (FRAMES, INSTANCES))
    return frames, instances, find_views(frames, instances, min_area, max_views, [range(5)])


def test_rows_go_by_instance_then_frame_and_leave_held_out_frames_out(scene):
    views = opened(scene())[2]
    rows = list(zip(views.instance.tolist(), views.frame.tolist(), views.area.tolist(), strict=True))
    first = [(0, frame, 77) for frame in range(4)]
    assert rows == [*first, *((1, frame, 450) for frame in range(4)), (2, 2, 24), (3, 3, 1)]
    assert views.box[1].tolist() == [3, 2, 14, 9] and views.box[-1].tolist() == [5, 5, 6, 6]
    assert [arr.dtype for arr in (views.instance, views.frame, views.area, views.box)] == [np.int32] * 4


@pytest.mark.parametrize("min_area, instances", [(24 / 1600, {0, 1, 2}), (25 / 1600, {0, 1}), (1.0, set())])
def test_small_masks_are_left_out(scene, min_area, instances):
    views = opened(scene(), min_area)[2]
    assert set(views.instance.tolist()) == instances and views.box.shape == (len(views), 4)


def test_views_are_limited_to_max_views_and_to_training_frames(scene):
    views = opened(scene(), max_views=2)[2]
    assert views.instance.tolist() == [0, 0, 1, 1, 2, 3] and views.frame.tolist() == [0, 2, 0, 2, 2, 3]
    views = opened(scene(train=np.zeros(5, bool)))[2]
    assert len(views) == 0 and views.box.shape == (0, 4)


@pytest.mark.parametrize("most", [1, 2, 3, 7, 10, 1000])
def test_views_are_spread_evenly(most):
    counts = np.array([1, 9, 100, 3])
    kept = spread(np.repeat(np.array([0, 2, 3, 9], np.int32), counts), most)
    for number, part in enumerate(np.split(kept, np.cumsum(counts)[:-1])):
        assert part.sum() == min(counts[number], most) and part[0]
        gaps = np.diff(np.flatnonzero(part))
        assert not len(gaps) or gaps.max() - gaps.min() <= 1


@pytest.mark.parametrize(
    ("format", "upright", "turned"), [("adt", True, False), ("adt", False, True), ("plain", False, False)]
)
def test_crops_are_upright(scene, format, upright, turned):
    frames, instances, views = opened(scene(format=format, upright=upright))
    views = views.chosen(views.by_frame)
    crops = list(cut_crops(frames, instances, views, WANTED, hull=False))
    assert len(crops) == len(views)
    expected = np.zeros((11, 11, 3), np.uint8)
    expected[2:9] = frames.row("rgb", 0)[2:9, :11]
    np.testing.assert_array_equal(crops[0], np.rot90(expected, -1) if turned else expected)


def test_each_frame_is_read_once(scene, monkeypatch):
    frames, instances, views = opened(scene())
    read, row = [], Artifact.row
    noted = lambda self, name, at: read.append((name, int(at))) or row(self, name, at)
    monkeypatch.setattr(Artifact, "row", noted)
    list(cut_crops(frames, instances, views.chosen(views.by_frame), WANTED, hull=False))
    assert sorted(read) == sorted((name, frame) for name in ("rgb", "labels") for frame in range(4))
