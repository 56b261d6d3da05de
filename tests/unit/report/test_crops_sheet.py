"""The page of crops is drawn from whatever its artifacts hold, and shows what it says."""

import numpy as np
import pytest

from egosplat.features.aggregation import aggregate
from egosplat.report.sheets.crops_sheet import (
    COLUMNS,
    DISTINCT,
    MOST_OUTLIERS,
    choose_instances,
    choose_views,
)
from tests.support.scenes import put_scene

SIZE, CHANNELS = 24, 12


def scene(folder, frames: int, instances: int, every_outlier: int, norm: str = "element"):
    """Each instance is in every frame; one view in ``every_outlier`` shows something else, later ones more so."""
    rng = np.random.default_rng(0)
    views = frames * instances
    labels = np.full((frames, 2, SIZE, SIZE), -1, np.int32)
    for instance in range(instances):
        labels[:, instance % 2, 3 * instance : 3 * instance + 3, 2:20] = instance
    box = np.array([[2, 3 * k, 20, 3 * k + 3] for k in range(instances)], np.int32).reshape(-1, 4)
    owner = np.repeat(np.arange(instances, dtype=np.int32), frames)
    feature = rng.normal(size=(instances, CHANNELS))[owner] + rng.normal(0, 0.05, (views, CHANNELS))
    wrong = np.arange(views) % every_outlier == 0
    noise = rng.normal(size=(wrong.sum(), CHANNELS))
    feature[wrong] += np.linspace(0.05, 2, len(noise))[:, None] * noise
    feature = feature.astype(np.float32)
    found = aggregate(feature, owner, instances, norm, 3.0)
    arrays = {
        "rgb": rng.integers(40, 255, (frames, SIZE, SIZE, 3), dtype=np.uint8),
        "labels": labels,
        "instances/level": (np.arange(instances) % 2).astype(np.int8),
        "instance": owner,
        "frame": np.tile(np.arange(frames, dtype=np.int32), instances),
        "feature": feature,
        "area": np.full(views, 54, np.int32),
        "box": np.repeat(box, frames, axis=0),
        "consistent": found.feature.astype(np.float32),
        "views": np.full(instances, frames, np.int32),
        "inlier": found.inlier,
        "supervision": feature,
        "code": feature[:, :2],
    }
    clip = {"small": True, "model": "small", "checkpoint": "small"}
    facts = {"levels": ["part", "whole"], "clip": clip, "turned": False, "outliers": 1}
    options = {"mad_norm": norm, "cut": "hull"}
    names = ["frames", "instances", "view_features", "features"]
    return put_scene(folder, names, arrays, facts, stage="frames", options=options, origin="real")


@pytest.mark.parametrize(
    "frames, instances, every_outlier", [(20, 6, 5), (2, 1, 100), (1, 0, 2)], ids=["usual", "few", "nothing"]
)
def test_the_page_is_written_as_one_picture(tmp_path, draw, frames, instances, every_outlier):
    picture = draw("crops_sheet", scene(tmp_path, frames, instances, every_outlier))
    assert picture.shape[1] > 1000 and picture.std() > 5
    red = (picture[..., 0] > 150) & (picture[..., 1:].max(axis=2) < 90)
    assert (red.sum() > 300) == (frames > 2)  # of two views none is an outlier


@pytest.mark.parametrize("norm", ["element", "none"])
def test_the_number_above_a_crop_decides_whether_it_is_struck_out(tmp_path, draw, drawn, norm):
    draw("crops_sheet", scene(tmp_path, 11, 6, 4, norm))
    struck: dict[bool, list[float]] = {True: [], False: []}
    for strip in drawn[0].subfigs:
        caption = strip.texts[0].get_text()
        limit = float(caption.partition("above ")[2]) if "above" in caption else 0.5
        for axes in strip.get_axes():
            frame, _, number = axes.title.get_text().partition(": ")
            if frame:
                struck[bool(axes.lines)].append(float(number) - limit)
            assert (axes.title.get_color() == "crimson") == bool(axes.lines)
    assert len(struck[False]) > 20
    if norm == "none":
        assert not struck[True]
    else:
        # Both are rounded to two decimals.
        assert len(struck[True]) >= 3 and min(struck[True]) >= -0.01
        assert max(struck[False]) <= 0.01


def choose(counts: list[int], outliers: dict[int, int], meaning: list[int], level: list[int]) -> list[int]:
    """The instances to show, of ``counts`` views each, the first of which are outliers; ``meaning`` is the axis of each."""
    owner = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    inlier = np.concatenate([np.arange(count) >= outliers.get(one, 0) for one, count in enumerate(counts)])
    return choose_instances(owner, inlier, np.array(level, np.int8), np.eye(len(counts))[meaning])


def test_the_instance_with_most_views_and_those_unlike_it_that_are_often_seen():
    assert choose([5, 9, 8, 1, 8, 3, 2, 2], {}, [0, 1, 1, 2, 3, 1, 4, 5], [0] * 8) == [1, 4, 0, 2]
    # One thing at several levels is shown once.
    assert choose([9, 9, 9, 9], {}, [0, 0, 1, 1], [2, 1, 2, 0]) == [0, 2]
    # Those with most outliers come last and not twice.
    outliers = {0: 4, 7: 3, 8: 2, 9: 1}
    chosen = choose([9] * 7 + [3] * 3, outliers, [0, 1, 2, 3, 4, 5, 6, 0, 0, 0], [1] * 7 + [1, 0, 0])
    assert len(chosen) == DISTINCT + MOST_OUTLIERS == len(set(chosen)) and chosen[-2:] == [7, 8]


def test_views_are_in_order_of_time_with_the_outliers_among_them():
    inlier = np.ones(40, bool)
    inlier[[3, 31]] = False
    rows = choose_views(inlier)
    assert len(rows) == COLUMNS and {3, 31, 0, 39} <= set(rows.tolist()) and (np.diff(rows) > 0).all()
    assert choose_views(np.ones(5, bool)).tolist() == [0, 1, 2, 3, 4]
    assert len(choose_views(np.arange(40) < 1)) == COLUMNS // 2 + 1
