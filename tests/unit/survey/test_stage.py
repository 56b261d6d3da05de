"""The stage: a whole document with its evidence, what it is refused for, and who may read it."""

import json

import numpy as np
import pytest

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.reader import open_artifact, recorded_digest
from egosplat.errors import UserError
from egosplat.pipeline.config import defaults, merge, stage_keys
from egosplat.pipeline.dag import decided
from egosplat.pipeline.survey_file import read_survey
from egosplat.survey import stage

KEYS = {name: key["default"] for name, key in stage_keys("survey").items()}
OPTIONS = stage.SurveyOptions(**KEYS)


def surveyed(folder, **keys):
    options = stage.SurveyOptions(**KEYS | keys)
    stage.run(folder / "frames.zarr", folder / "poses.zarr", folder / "survey.json", options)
    return read_survey(folder / "survey.json")


def test_a_static_scene_needs_no_masks(scene, walks, still):
    folder = scene(walks, still)
    found = surveyed(folder)
    motion = found["motion"]
    assert motion["static"] and motion["masking"] == "none" and motion["share"] == 0
    assert motion["measured"] > 0.3 and len(motion["pairs"]) == 7
    assert found["origin"] == found["provenance"]["origin"] == "synthetic"
    assert found["provenance"]["options"] == KEYS and found["provenance"]["stage"] == "survey"
    assert found["provenance"]["inputs"] == {
        name: recorded_digest(folder / name) for name in ("frames.zarr", "poses.zarr")
    }
    assert found["poses"] == {"source": "colmap", "registered": 8, "frames": 8, "points": 288}


def test_a_moving_scene_needs_masks_above_the_threshold(scene, walks, moving):
    folder = scene(walks, moving)
    found = surveyed(folder)["motion"]
    assert not found["static"] and found["masking"] == "refined" and found["share"] > 0.005
    assert surveyed(folder, max_moving_share=1.0)["motion"]["masking"] == "none"


def test_without_measurements_the_scene_counts_as_moving(scene, walks, still):
    folder = scene(walks[:1], still[:1], train=np.ones(1, bool), evaluation=np.zeros(1, bool))
    motion = surveyed(folder)["motion"]
    assert motion["masking"] == "refined" and motion["share"] is None and motion["pairs"] == []


def test_views_that_add_nothing_are_left_out_but_never_one_of_the_evaluation(scene, walks, still):
    """Each step is 4.6 degrees at 1 m, and at most that at the wall."""
    folder = scene(walks, still)
    views = surveyed(folder, min_view_change_deg=6.0)["views"]
    assert sorted(views["kept"] + views["left_out"]) == list(range(8))
    assert {0, 2, 6, 7} <= set(views["kept"]) and views["left_out"]
    assert surveyed(folder, min_view_change_deg=0.0)["views"]["left_out"] == []


def test_the_same_scene_twice_is_decided_alike(scene, walks, moving):
    folder = scene(walks, moving)
    first, second = surveyed(folder), surveyed(folder)
    assert all(first[part] == second[part] for part in ("motion", "views", "poses"))


def test_a_scene_without_points_keeps_all_its_frames(scene, walks, still):
    none = {"points/xyz": np.zeros((0, 3)), "points/rgb": np.zeros((0, 3), np.uint8)}
    found = surveyed(scene(walks, still, **none))
    assert found["views"]["left_out"] == [] and found["views"]["median_depth_m"] is None
    assert found["motion"]["static"]


def test_poses_of_other_frames_are_rejected(scene, walks, still):
    folder = scene(walks, still)
    (folder / "poses.zarr").rename(folder / "other.zarr")
    scene(walks[:4], still[:4])
    (folder / "other.zarr").rename(folder / "of_eight.zarr")
    with pytest.raises(UserError, match="was made from another frames.zarr"):
        stage.run(folder / "frames.zarr", folder / "of_eight.zarr", folder / "survey.json", OPTIONS)
    assert not (folder / "survey.json").exists()


def test_later_stages_record_the_kept_frames(scene, walks, still):
    folder = scene(walks, still)
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    found = surveyed(folder, min_view_change_deg=6.0)["views"]
    kept, said = kept_frames(frames, folder / "survey.json")
    assert np.flatnonzero(kept).tolist() == found["kept"] and said == {"kept_frames": found["digest"]}
    every, nothing = kept_frames(frames, None)
    assert every.all() and nothing == {}


def test_a_survey_of_other_frames_is_rejected(scene, walks, still, moving):
    folder = scene(walks, still)
    surveyed(folder)
    scene(walks, moving)
    with pytest.raises(UserError, match=r"survey\.json: was made from another frames.zarr than"):
        kept_frames(open_artifact(folder / "frames.zarr", FRAMES), folder / "survey.json")


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "does not exist. Make it: snakemake"),
        ("{", "cannot be read as JSON"),
        ("[]", "is no survey of this egosplat: it: "),
        ({"format_version": 99}, "is no survey of this egosplat: format_version"),
        ({"motion": {}}, "is no survey of this egosplat: motion"),
    ],
)
def test_a_damaged_survey_is_named(scene, walks, still, content, message):
    folder = scene(walks[:2], still[:2])
    path = folder / "survey.json"
    document = dict(surveyed(folder))
    path.unlink()
    if content is not None:
        path.write_text(content if isinstance(content, str) else json.dumps(document | content))
    with pytest.raises(UserError, match=message):
        read_survey(path)


@pytest.mark.parametrize(
    "asked, expected", [("auto", "none"), ("refined", "refined"), ("initial", "initial")]
)
def test_an_explicit_value_overrides_the_survey(asked, expected):
    config = merge(defaults(), {"splats": {"masking": asked}})
    assert decided(config, {"motion": {"masking": "none"}})["splats"]["masking"] == expected


def test_motion_is_measured_at_low_resolution(scene, walks, still, room):
    large = [np.kron(one, np.ones((2, 2), np.uint8)) for one in still[:3]]
    folder = scene(
        walks[:3],
        large,
        valid=np.ones((2 * room.size, 2 * room.size), bool),
        intrinsics=np.diag([2.0, 2.0, 1.0]) @ np.array([[120.0, 0, 80], [0, 120, 80], [0, 0, 1]]),
    )
    assert surveyed(folder)["motion"]["share"] == 0
