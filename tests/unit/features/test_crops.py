"""Views are large, few and of training frames; crops show one instance on black, centered and upright."""

import numpy as np
import pytest

from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES
from egosplat.features.crops import cut_crop, cut_crops, fill_hull, find_regions, find_views, resize, spread
from egosplat.models.clip import Preprocessing


def test_each_instance_has_its_area_and_box_at_any_level():
    labels = np.full((2, 6, 8), -1, np.int32)
    labels[0, 1:3, 2:5] = 3
    labels[0, 5, 7] = labels[0, 3, 6] = 0
    labels[1, :, :] = 2
    labels[1, 2:4, 2:4] = -1
    found = find_regions(labels, 5)
    assert found.instance.tolist() == [0, 2, 3]
    assert found.area.tolist() == [2, 44, 6]
    assert found.box.tolist() == [[6, 3, 8, 6], [0, 0, 8, 6], [2, 1, 5, 3]]
    for shape, count in (((1, 4, 4), 0), ((0, 4, 4), 0), ((2, 3, 3), 4)):
        nothing = find_regions(np.full(shape, -1, np.int32), count)
        assert len(nothing.instance) == len(nothing.area) == 0 and nothing.box.shape == (0, 4)


def test_a_crop_is_black_outside_of_the_mask_and_centered_in_a_square():
    rgb = np.arange(10 * 12 * 3, dtype=np.uint8).reshape(10, 12, 3) + 1
    labels = np.full((10, 12), -1, np.int32)
    labels[2:4, 3:9] = 7
    labels[2, 3] = 1
    crop = cut_crop(rgb, labels, 7, np.array([3, 2, 9, 4]))
    assert crop.shape == (6, 6, 3)
    assert (crop[2, 1:] == rgb[2, 4:9]).all() and (crop[3] == rgb[3, 3:9]).all()
    assert not crop[[0, 1, 4, 5]].any() and not crop[2, 0].any()


@pytest.mark.parametrize("height, width, top, left", [(1, 1, 0, 0), (5, 2, 0, 1), (2, 5, 1, 0), (3, 4, 0, 0)])
def test_every_shape_is_centered(height, width, top, left):
    labels = np.zeros((6, 6), np.int32)
    crop = cut_crop(np.full((6, 6, 3), 9, np.uint8), labels, 0, np.array([0, 0, width, height]))
    side = max(height, width)
    expected = np.zeros((side, side), bool)
    expected[top : top + height, left : left + width] = True
    assert ((crop == 9).all(axis=2) == expected).all()


@pytest.mark.parametrize("interpolation", ["bicubic", "bilinear"])
@pytest.mark.parametrize("side", [1, 31, 32, 200])
def test_crops_get_the_model_s_size_and_keep_their_brightness(side, interpolation):
    resized = resize(np.full((side, side, 3), 77, np.uint8), (32, 48), interpolation)
    assert resized.shape == (32, 48, 3) and (resized == 77).all()


def test_shrinking_averages():
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 200
    assert np.abs(resize(stripes, (8, 8), "bicubic").astype(int)[:, 1:-1] - 100).max() < 8


def test_a_hull_fills_what_a_mask_leaves_out_and_its_crop_shows_the_picture_there():
    mask = np.zeros((7, 9), bool)
    mask[1:6, 1] = mask[1, 1:8] = mask[5, 1:8] = True
    expected = np.zeros((7, 9), bool)
    expected[1:6, 1:8] = True
    np.testing.assert_array_equal(fill_hull(mask), expected)
    for empty_or_thin in (np.zeros((3, 3), bool), np.eye(1, dtype=bool), np.eye(5, dtype=bool)):
        np.testing.assert_array_equal(fill_hull(empty_or_thin), empty_or_thin)
    rgb = np.arange(7 * 9 * 3, dtype=np.uint8).reshape(7, 9, 3) + 1
    crop = cut_crop(rgb, np.where(mask, 3, -1), 3, np.array([1, 1, 8, 6]), hull=True)
    np.testing.assert_array_equal(crop[1:6], rgb[1:6, 1:8])
    assert not crop[[0, 6]].any()


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
    views = views[np.argsort(views.frame, kind="stable")]
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
    list(cut_crops(frames, instances, np.sort(views, order="frame"), WANTED, hull=False))
    assert sorted(read) == sorted((name, frame) for name in ("rgb", "labels") for frame in range(4))
