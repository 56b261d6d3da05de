"""Results of a run without a target."""

from dataclasses import replace
from pathlib import Path

import pytest

from egosplat.pipeline.config import defaults, merge
from egosplat.pipeline.results import default_results, default_scenes, results_by_survey
from egosplat.pipeline.scenes import Scene

CONFIG = merge(defaults(), {"variants": {"v": {"features": {"dims": 4}}}})


@pytest.fixture
def scenes(tmp_path, monkeypatch):
    """A synthetic scene, a recording that exists, one that does not, and a scene that is made by name alone."""
    monkeypatch.chdir(tmp_path)
    Path("clip.mp4").touch()
    rows = [
        Scene("adt", "one", "adt", Path("results/adt/one/recording"), True, CONFIG),
        Scene("mine", "here", "plain", Path("clip.mp4"), False, CONFIG),
        Scene("mine", "absent", "plain", Path("absent.mp4"), False, CONFIG),
        Scene("adt", "named", "adt", Path("results/adt/named/recording"), True, CONFIG, by_name=True),
    ]
    return {(row.dataset, row.scene): row for row in rows}


def test_a_run_without_a_target_takes_scenes_whose_recording_exists_or_can_be_made(scenes):
    """Protects ``snakemake`` without a target from recordings that nobody requested."""
    assert [scene.name for scene in default_scenes(scenes.values())] == ["adt/one", "mine/here"]
    assert "results/adt/one/metrics.json" in default_results(scenes["adt", "one"])


@pytest.mark.parametrize(
    "keys, moving, pages",
    [
        ({}, "refined", {"transient.png", "carries.png"}),
        ({"segments": {"track_moving": "never"}}, "refined", {"transient.png"}),
        ({"splats": {"masking": "refined"}}, "refined", {"carries.png"}),
        ({"splats": {"masking": "none"}, "segments": {"track_moving": "always"}}, "refined", set()),
        ({}, "none", set()),
    ],
)
def test_a_survey_that_finds_motion_adds_what_it_decides(scenes, keys, moving, pages):
    """Protects ``snakemake`` without a target: each page is in one of the two lists of results."""
    scene = replace(scenes["mine", "here"], config=merge(CONFIG, keys))
    found = {"motion": {"masking": moving}, "camera": {"refine_poses": True, "compensate_exposure": True}}
    added = results_by_survey(scene, found)
    assert added == [path for path in added if path not in default_results(scene)]
    assert {Path(path).name for path in added} == pages
