"""Stage ``survey``: its document, its errors, and the frames that later stages read from it."""

import json

import numpy as np
import pytest

from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES
from egosplat.errors import UserError
from egosplat.pipeline.config import defaults, stage_values
from egosplat.pipeline.validation import read_document
from egosplat.survey import stage
from tests.support.scenes import digests
from tests.unit.survey.conftest import CAMERA

KEYS = stage_values("survey", defaults())
OPTIONS = stage.SurveyOptions(**KEYS)


def surveyed(folder, **keys):
    options = stage.SurveyOptions(**KEYS | keys)
    stage.run(folder / "frames.zarr", folder / "poses.zarr", folder / "survey.json", options)
    return read_document(folder / "survey.json", "survey")


def test_a_static_scene_needs_no_masks(scene, trajectory, still):
    folder = scene(trajectory, still)
    survey = surveyed(folder)
    motion = survey["motion"]
    assert motion["verdict"].startswith("nothing in view keeps moving") and motion["masking"] == "none"
    assert motion["voting"] > 0.3 and motion["noise_px"] < 0.3 and len(motion["pairs"]) == 7
    assert not survey["camera"]["refine_poses"] and not survey["camera"]["compensate_exposure"]
    assert survey["origin"] == survey["provenance"]["origin"] == "synthetic"
    assert survey["provenance"]["options"] == KEYS and survey["provenance"]["stage"] == "survey"
    assert survey["provenance"]["inputs"] == digests(folder, ["frames", "poses"])
    assert survey["poses"] == {"source": "colmap", "registered": 8, "frames": 8, "points": 288}


def test_a_moving_scene_needs_masks_above_the_threshold(scene, trajectory, moving):
    folder = scene(trajectory, moving)
    survey, again = surveyed(folder), surveyed(folder)
    assert all(survey[part] == again[part] for part in ("motion", "views", "poses"))
    motion = survey["motion"]
    assert "keeps moving" in motion["verdict"] and motion["masking"] == "refined" and motion["share"] > 0.005
    assert surveyed(folder, min_moving_share=1.0)["motion"]["masking"] == "none"


def test_without_measurements_the_scene_counts_as_moving(scene, trajectory, still):
    folder = scene(trajectory[:1], still[:1], train=np.ones(1, bool), evaluation=np.zeros(1, bool))
    motion = surveyed(folder)["motion"]
    assert motion["masking"] == "refined" and motion["share"] is None and motion["pairs"] == []


def test_a_scene_without_points_keeps_all_its_frames(scene, trajectory, still):
    none = {"points/xyz": np.zeros((0, 3)), "points/rgb": np.zeros((0, 3), np.uint8)}
    survey = surveyed(scene(trajectory, still, **none))
    assert survey["views"]["left_out"] == [] and survey["views"]["median_depth_m"] is None
    assert survey["motion"]["masking"] == "none"


def test_later_stages_skip_redundant_training_views(scene, trajectory, still, moving):
    """Each camera step is 4.6 degrees at 1 m, and less at the wall. Surveys and poses of other frames are rejected."""
    folder = scene(trajectory, still)
    assert surveyed(folder, min_view_change_deg=0.0)["views"]["left_out"] == []
    frames, path = open_artifact(folder / "frames.zarr", FRAMES), folder / "survey.json"
    views = surveyed(folder, min_view_change_deg=6.0)["views"]
    assert sorted(views["kept"] + views["left_out"]) == list(range(8)) and views["left_out"]
    assert {0, 2, 6, 7} <= set(views["kept"]), "evaluation views, too"
    kept, recorded = kept_frames(frames, path)
    assert np.flatnonzero(kept).tolist() == views["kept"] and recorded == {"kept_frames": views["digest"]}
    kept, recorded = kept_frames(frames, None)
    assert kept.all() and recorded == {}
    (folder / "poses.zarr").rename(folder / "other.zarr")
    scene(trajectory[:4], moving[:4])
    with pytest.raises(UserError, match="was made from another frames.zarr"):
        stage.run(folder / "frames.zarr", folder / "other.zarr", folder / "new.json", OPTIONS)
    assert not (folder / "new.json").exists()
    with pytest.raises(UserError, match=r"survey\.json: was made from another frames.zarr than"):
        kept_frames(open_artifact(folder / "frames.zarr", FRAMES), path)


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "survey.json: does not exist"),
        ("{", "cannot be read as JSON"),
        ("[]", "value = .. is not allowed"),
        ({"format_version": 99}, "format_version = 99"),
        ({"motion": {}}, "motion = "),
    ],
)
def test_a_damaged_survey_is_named(scene, trajectory, still, survey_that_keeps, content, message):
    path = survey_that_keeps(scene(trajectory[:2], still[:2]), [0, 1])
    if content is None:
        path.unlink()
    else:
        changed = content if isinstance(content, str) else json.dumps(read_document(path, "survey") | content)
        path.write_text(changed)
    with pytest.raises(UserError, match=message):
        read_document(path, "survey")


def test_motion_is_measured_at_low_resolution(scene, trajectory, still):
    large = [np.kron(one, np.ones((2, 2), np.uint8)) for one in still[:3]]
    valid, intrinsics = np.ones(large[0].shape, bool), np.diag([2.0, 2.0, 1.0]) @ CAMERA.matrix
    folder = scene(trajectory[:3], large, valid=valid, intrinsics=intrinsics)
    assert surveyed(folder)["motion"]["share"] == 0
