"""Facts and arrays of each kind of artifact raise its alarms, and commands log them."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from egosplat.alarms.artifact_alarms import alarm_line, alarms_of, log_warnings
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.models.suitability import notice
from tests.support.scenes import put

FIGURES = {"pixels_without_instance": 0.6, "instances_per_frame": 2.0, "frames_per_instance": 2.0}

NOTES = {"reprojection_error_px": 1.5, "models": [8, 2], "parallax_deg": 0.4, "points": 100}
NOTES["seam"] = {"after": 4, "share": 0.1}

SUSPICIOUS = {
    "frames": ({"valid": np.arange(10) < 4, "train": np.ones(8, bool)}, {}, ["frames.valid_pixels"]),
    "poses": (
        {"registered": np.arange(10) < 8},
        {"notes": NOTES},
        [f"poses.{name}" for name in ("registered", "reprojection", "parallax", "points", "models", "seam")],
    ),
    "transient": ({}, {"mean_probability": 0.47}, ["transient.probability"]),
    "segments": ({}, FIGURES, [f"segments.{name}" for name in ("empty_pixels", *list(FIGURES)[1:])]),
    "instances": (
        {"instances/masks": np.array([2, 1, 90], np.int32), "instances/moving": np.arange(3) == 2},
        {"merging": {"part": {"masks": 4}, "whole": {"masks": 5}}, "pixels_without_instance": 0.2},
        ["instances.masks_kept", "instances.empty_pixels"],
    ),
    "view_features": ({"instance": np.zeros(9, np.int32)}, {"without_feature": 1}, ["view_features.lost"]),
    "features": (
        {"instance": np.zeros(9, np.int32)},
        {"outliers": 3, "agreement": 0.6, "spread": {"features": 0.5}, "reconstruction": {"mean": 0.7}},
        ["features.outliers", "features.agreement", "features.reconstruction"],
    ),
    "masks": (
        {"instances/transient": np.arange(68) < 36},
        {"masked_share": 0.3},
        ["masks.instances", "masks.pixels"],
    ),
    "splats": (
        {
            "held_out/psnr": np.array([25.0, 12.0]),
            "corrections/shift": np.array([[0.0, 0.11, 0.0], [0.0, 0.0, 0.01]]),
            "corrections/turn": np.zeros(2),
            "corrections/gain": np.array([[1.0, 0.3, 1.0], [1.0, 1.0, 1.0]]),
        },
        {"scene_depth": 2.0},
        ["splats.psnr", "splats.pose_correction", "splats.gain"],
    ),
    "language": (
        {"share": np.stack([np.arange(9) < 5, np.zeros(9, bool)], axis=1).astype(np.float32)},
        {},
        ["language.without_code"],
    ),
}
"""By kind: arrays, facts, and the keys of the alarms that they raise."""


def written(folder: Path, kind: str, arrays: dict[str, np.ndarray], facts: dict, **more) -> Artifact:
    """Write an artifact. Missing last axes of arrays get size 1."""
    fields = SCHEMAS[kind].fields
    whole = {
        name: values.reshape(values.shape + (1,) * (len(fields[name].dims) - values.ndim))
        for name, values in arrays.items()
    }
    return open_artifact(put(folder, kind, whole, facts, size=1, **more), SCHEMAS[kind])


CASES = [
    *((kind, *case) for kind, case in SUSPICIOUS.items()),
    # Masks of single frames have no length, tracks no counts of merging.
    ("segments", {}, {"pixels_without_instance": 0.6}, ["segments.empty_pixels"]),
    ("instances", {"instances/masks": np.ones(3, np.int32)}, {"source": "tracks"}, []),
    ("annotations", {}, {}, []),
]


@pytest.mark.parametrize("kind, arrays, facts, keys", CASES)
def test_facts_and_arrays_of_an_artifact_raise_its_alarms(tmp_path, kind, arrays, facts, keys):
    """Each has the figures that its sentence tells, as plain numbers that JSON can hold."""
    found = alarms_of(written(tmp_path, kind, dict(arrays), facts))
    assert [alarm.key for alarm in found] == keys
    for alarm in found:
        assert "\n" not in alarm_line(alarm)
        json.dumps(asdict(alarm))


def test_small_checkpoints_on_a_real_recording_are_reported_before_the_alarms(tmp_path, capfd):
    small = {"sam2_checkpoint": "small"}
    real = {"options": small, "origin": "real", "models": {"sam2_checkpoint": "c0de"}}
    written(tmp_path, "segments", {}, FIGURES, **real)
    log_warnings("segments", tmp_path / "segments.zarr", is_step=False)
    first, *others = capfd.readouterr().err.splitlines()
    assert first == f"notice: {notice('real', small)}"
    log_warnings("segments", tmp_path / "segments.zarr", is_step=True)
    assert capfd.readouterr().err.splitlines() == others
    assert len(others) == 3 and all(line.startswith("alarm: segments.") for line in others)


@pytest.mark.parametrize("stride", [1, 5])
def test_a_smaller_stride_is_advised_where_there_is_one(tmp_path, stride):
    put(tmp_path, "frames", {"train": np.ones(10, bool)}, options={"stride": stride})
    arrays = {"registered": np.arange(10) < 8}
    (alarm,) = alarms_of(written(tmp_path, "poses", arrays, {}, made_from=["frames"]))
    line = alarm_line(alarm)
    assert ("reduce frames.stride" in line) == ("Made with frames.stride 5" in line) == (stride == 5)
    assert "[" not in line and line.endswith("others" if stride == 1 else "frames.stride")


@pytest.mark.parametrize("architecture, told", [("small", True), ("sam2.1_hiera_t", False)])
def test_other_models_are_advised_where_they_do_not_serve(tmp_path, architecture, told):
    figures = FIGURES | {"frames_per_instance": 9.0}
    for alarm in alarms_of(written(tmp_path, "segments", {}, figures, options={"sam2_config": architecture})):
        line = alarm_line(alarm)
        assert ("models.set" in line) == told and "raise segments.points_per_side" in line


def test_an_alarm_tells_no_key_of_the_same_name_of_another_stage(tmp_path):
    """Masks are merged on temporary Gaussians: instances and splats both have iterations and a source."""
    arrays, facts, _ = SUSPICIOUS["instances"]
    options = {"iterations": 1000, "source": "auto"}
    for alarm in alarms_of(written(tmp_path, "instances", dict(arrays), facts, options=options)):
        assert "Made with" not in alarm_line(alarm) and "; raise splats.iterations" in alarm_line(alarm)


def test_models_of_colmap_are_named_with_their_frames(tmp_path):
    notes = {"models": [40, 7]}
    (alarm,) = alarms_of(written(tmp_path, "poses", {"registered": np.ones(47, bool)}, {"notes": notes}))
    assert alarm.figures == {"value": 2.0, "limit": 1, "frames": "40, 7"}


def test_masks_that_were_withheld_say_why(tmp_path):
    facts = {"withheld": "probability", "withheld_instances": 3, "seen": 40, "mean_probability": 0.6}
    arrays = {"instances/transient": np.zeros(40, bool)}
    (alarm,) = alarms_of(written(tmp_path, "masks", arrays, facts | {"masked_share": 0.0}))
    assert (alarm.key, alarm.figures["probability"]) == ("masks.withheld", 0.6)
    assert "3 of 40" in alarm_line(alarm)


def test_frames_without_a_pose_have_no_correction(tmp_path):
    arrays = dict(SUSPICIOUS["splats"][0], **{"held_out/psnr": np.array([30.0, np.nan])})
    arrays["corrections/shift"] = np.array([[np.nan] * 3, [0.0, 0.11, 0.0]])
    arrays["corrections/gain"] = np.array([[np.nan] * 3, [1.0, 1.0, 1.0]])
    (alarm,) = alarms_of(written(tmp_path, "splats", arrays, {"scene_depth": 2.0}))
    assert (alarm.key, alarm.figures["wrong"], alarm.figures["frame"]) == ("splats.pose_correction", 1, 1)
