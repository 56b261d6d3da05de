"""The page of crops is drawn from whatever its artifacts hold, and shows what it says."""

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.view_features import VIEW_FEATURES
from egosplat.artifacts.writing import create
from egosplat.errors import UserError
from egosplat.provenance import begin
from egosplat.report.crops_sheet import COLUMNS, Table, choose_instances, choose_views, run

SIZE, CHANNELS = 24, 4


def scene(folder, frames: int, instances: int, every_outlier: int):
    """Each instance is in every frame; every so manieth view is an outlier."""
    rng = np.random.default_rng(0)
    views = frames * instances
    labels = np.full((frames, 2, SIZE, SIZE), -1, np.int32)
    for instance in range(instances):
        labels[:, instance % 2, 3 * instance : 3 * instance + 3, 2:20] = instance
    box = np.array([[2, 3 * k, 20, 3 * k + 3] for k in range(instances)], np.int32).reshape(-1, 4)
    feature = rng.normal(size=(views, CHANNELS)).astype(np.float32)
    arrays = {
        "rgb": rng.integers(40, 255, (frames, SIZE, SIZE, 3), dtype=np.uint8),
        "valid": np.ones((SIZE, SIZE), bool),
        "timestamp_ns": np.arange(frames),
        "exposure_middle_ns": np.arange(frames),
        "train": np.ones(frames, bool),
        "evaluation": np.zeros(frames, bool),
        "labels": labels,
        "instances/level": (np.arange(instances) % 2).astype(np.int8),
        "instances/predicted_iou": np.ones(instances, np.float32),
        "instances/stability": np.ones(instances, np.float32),
        "instances/first_frame": np.zeros(instances, np.int64),
        "instance": np.repeat(np.arange(instances, dtype=np.int32), frames),
        "frame": np.tile(np.arange(frames, dtype=np.int32), instances),
        "feature": feature,
        "area": np.full(views, 54, np.int32),
        "box": np.repeat(box, frames, axis=0),
        "consistent": rng.normal(size=(instances, CHANNELS)).astype(np.float32),
        "views": np.full(instances, frames, np.int32),
        "inlier": np.arange(views) % every_outlier != 0,
        "supervision": feature,
        "code": feature[:, :2],
        "consistent_code": np.zeros((instances, 2), np.float32),
        "decoder/values": np.zeros(12, np.float32),
    }
    facts = {
        "levels": ["part", "whole"],
        "clip": {"small": True, "model": "small", "checkpoint": "small"},
        "turned": False,
        "outliers": 1,
    }
    options = {"mad_norm": "element", "mad_k": 3.0}
    for schema in (FRAMES, SEGMENTS, VIEW_FEATURES, FEATURES):
        with create(folder / f"{schema.name}.zarr", schema, begin("frames", options, "real")) as artifact:
            for name in schema.fields:
                artifact.put(name, arrays[name])
            artifact.facts = facts
    return [folder / f"{name}.zarr" for name in ("frames", "segments", "view_features", "features")]


@pytest.mark.parametrize(
    "frames, instances, every_outlier", [(20, 6, 5), (2, 1, 100), (1, 0, 2)], ids=["usual", "few", "nothing"]
)
def test_a_picture_is_made(tmp_path, frames, instances, every_outlier):
    output = tmp_path / "crops.png"
    run(*scene(tmp_path, frames, instances, every_outlier), output, title="a scene")
    picture = np.asarray(Image.open(output).convert("RGB")).astype(int)
    assert picture.shape[1] > 1000 and picture.std() > 5
    red = (picture[..., 0] > 150) & (picture[..., 1:].max(axis=2) < 90)
    assert (red.sum() > 300) == (instances > 0)  # the first view of all is an outlier
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".png"] == ["crops.png"]


def test_features_of_other_views_are_refused(tmp_path):
    (tmp_path / "other").mkdir()
    paths = scene(tmp_path, 3, 2, 5)
    paths[3] = scene(tmp_path / "other", 4, 2, 5)[3]
    with pytest.raises(UserError, match=r"features.zarr: was made from other views"):
        run(*paths, tmp_path / "crops.png", title="a scene")


def table(counts: list[int], level: list[int], outliers: dict[int, list[int]]) -> Table:
    """Of each instance so many views, and which of them are outliers."""
    instance = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    place = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
    inlier = np.array([p not in outliers.get(int(i), []) for i, p in zip(instance, place, strict=True)], bool)
    box = np.repeat(instance[:, None], 4, axis=1)
    return Table(instance, place, box, inlier, place / 100, np.array(level, np.int8))


def test_the_instances_with_most_views_of_each_level_and_those_with_most_outliers():
    some = table([5, 9, 7, 1, 3, 4], [0, 0, 0, 1, 1, 0], {1: [0, 1, 2], 5: [0, 1], 0: [2]})
    assert choose_instances(some) == [1, 2, 4, 3, 5, 0]
    assert choose_instances(table([5, 9], [0, 0], {0: [1]})) == [1, 0]
    assert choose_instances(table([0, 0], [0, 0], {})) == []


def test_what_is_the_same_at_two_levels_is_shown_once():
    some = table([6, 5, 6, 4], [0, 0, 1, 1], {})
    some.box[some.instance == 2] = some.box[some.instance == 0]
    assert choose_instances(some) == [0, 1, 3]


def test_views_are_in_order_of_time_with_the_outliers_among_them():
    some = table([40, 5], [0, 0], {0: [3, 31]})
    rows = choose_views(some, 0)
    assert len(rows) == COLUMNS and {3, 31, 0, 39} <= set(rows.tolist()) and (np.diff(rows) > 0).all()
    assert choose_views(some, 1).tolist() == [40, 41, 42, 43, 44]
    wrong = choose_views(table([40], [0], {0: list(range(1, 40))}), 0)
    assert len(wrong) == COLUMNS // 2 + 1
