"""What a plan says of small checkpoints on real recordings, by what is asked for."""

import json
from pathlib import Path

import pytest

from egosplat.doctor.notices import left_out_notices, plan_notices, scene_notice
from egosplat.pipeline import config as configuration
from egosplat.pipeline.scenes import Scene, requested_targets


@pytest.fixture
def table(tmp_path):
    """Scenes by dataset and name: two real, one absent, two synthetic, one with published models."""
    defaults = configuration.defaults() | {
        "variants": {"published": {"models": {"clip_checkpoint": "b", "sam2_checkpoint": "a"}}}
    }
    published = configuration.merge(defaults, {"models": {"sam2_checkpoint": "a", "clip_checkpoint": "b"}})
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


def test_without_a_target_all_real_scenes_with_small_checkpoints_are_named_on_one_line(table):
    (line,) = planned(table)
    assert line == f"mine/a, mine/b: {scene_notice(table['mine', 'a'])}" and "\n" not in line


@pytest.mark.parametrize("name", ["absent", "rich"])
def test_a_scene_that_is_not_there_or_has_published_models_is_not_named(table, name):
    assert planned(table, f"results/mine/{name}/metrics.json") == []


@pytest.mark.parametrize("name", ["made", "kept"])
def test_a_synthetic_recording_is_not_named_wherever_it_lies(table, name):
    assert scene_notice(table["adt", name]) is None


def test_what_is_asked_for_decides_and_a_variant_by_its_own_models(table):
    (line,) = planned(table, "results/mine/b/splats.png", "results/mine/b/metrics.json")
    assert line.startswith("mine/b: ")
    assert planned(table, "results/mine/b/variants/published/metrics.json") == []


def test_a_run_of_everything_names_the_user_s_rows_that_it_leaves_out(table):
    """The table's rows of the paper's datasets wait for a root, and what is asked for by name is refused elsewhere."""
    (line,) = left_out_notices(table, [])
    assert "mine/absent (" in line and "none.mp4)" in line and "mine/a " not in line and "adt" not in line
    waiting = Scene("hoi4d", "s", "hoi4d", Path("nowhere"), False, configuration.defaults())
    assert left_out_notices({("hoi4d", "s"): waiting}, []) == []
    assert left_out_notices(table, requested_targets(["results/mine/a/splats.png"])) == []
