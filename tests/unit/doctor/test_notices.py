"""Notices of a plan about small checkpoints on real recordings, by requested targets."""

import json
from pathlib import Path

import pytest

from egosplat.doctor.inputs import left_out_notices, plan_notices, scene_notice
from egosplat.pipeline import config as configuration
from egosplat.pipeline.scenes import Scene, requested_targets


@pytest.fixture
def table(tmp_path):
    """Scenes by dataset and name: two real, one absent, two synthetic, one with published models."""
    models = {"models": {"clip_checkpoint": "b", "sam2_checkpoint": "a"}}
    defaults = configuration.configure([configuration.Layer("mine", {"variants": {"published": models}})])
    published = configuration.merge(defaults, models)
    (tmp_path / "video.mp4").touch()
    (tmp_path / "sequence").mkdir()
    (tmp_path / "sequence" / "metadata.json").write_text(json.dumps({"origin": "synthetic"}))
    rows = [
        Scene("mine", "a", "plain", tmp_path / "video.mp4", False, defaults),
        Scene("mine", "b", "plain", tmp_path / "video.mp4", False, defaults),
        Scene("mine", "absent", "plain", tmp_path / "none.mp4", False, defaults),
        Scene("mine", "rich", "plain", tmp_path / "video.mp4", False, published),
        Scene("adt", "made", "adt", tmp_path / "recording", True, defaults),
        Scene("adt", "kept", "adt", tmp_path / "sequence", False, defaults),
    ]
    return {(one.dataset, one.scene): one for one in rows}


def planned(table, *words: str) -> list[str]:
    return plan_notices(table, requested_targets(list(words)))


def test_all_real_scenes_with_small_checkpoints_share_a_line(table):
    """Without targets, one line names every scene that the small checkpoints do not suit."""
    (line,) = planned(table)
    assert line == f"mine/a, mine/b: {scene_notice(table['mine', 'a'])}" and "\n" not in line


@pytest.mark.parametrize("name", ["absent", "rich"])
def test_missing_scenes_and_published_models_are_not_named(table, name):
    """No warning where none is due."""
    assert planned(table, f"results/mine/{name}/metrics.json") == []


@pytest.mark.parametrize("name", ["made", "kept"])
def test_a_synthetic_recording_is_not_named(table, name):
    """The small checkpoints were trained on it, wherever it is stored."""
    assert scene_notice(table["adt", name]) is None


def test_only_targets_are_named_and_variants_by_their_own_models(table):
    """A variant may use other models than its scene."""
    (line,) = planned(table, "results/mine/b/splats.png", "results/mine/b/metrics.json")
    assert line.startswith("mine/b: ")
    assert planned(table, "results/mine/b/variants/published/metrics.json") == []


def test_skipped_rows_of_the_user_are_named(table):
    """A run of everything skips rows without recording; the user must see it."""
    (line,) = left_out_notices(table, [])
    assert "mine/absent (" in line and "none.mp4)" in line and "mine/a " not in line and "adt" not in line
    waiting = Scene("hoi4d", "s", "hoi4d", Path("nowhere"), False, configuration.defaults())
    assert left_out_notices({("hoi4d", "s"): waiting}, []) == []
    assert left_out_notices(table, requested_targets(["results/mine/a/splats.png"])) == []
