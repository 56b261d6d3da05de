"""The stage segments: its artifact for a small video, merging and dropping of instances, errors."""

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SEGMENTS
from egosplat.errors import UserError
from egosplat.pipeline.config import defaults, stage_values
from egosplat.segments import stage
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.options import SegmentsOptions
from tests.support.scenes import put

COUNT, SIDE = 6, 64


@pytest.fixture(scope="module")
def keys():
    return stage_values("segments", defaults())


@pytest.fixture
def frames(tmp_path):
    """A red and a blue square that move over a grey ground."""
    rgb = np.full((COUNT, SIDE, SIDE, 3), 120, np.uint8)
    for frame in range(COUNT):
        rgb[frame, 10:30, 4 + 3 * frame : 24 + 3 * frame] = (220, 30, 30)
        rgb[frame, 40:60, 40 - 2 * frame : 60 - 2 * frame] = (30, 30, 220)
    valid = np.ones((SIDE, SIDE), bool)
    valid[:2] = False
    return put(tmp_path, "frames", {"rgb": rgb, "valid": valid}, {"upright": True})


def test_classical_segments_of_moving_squares(frames, tmp_path, keys):
    output = tmp_path / "segments.zarr"
    stage.run(frames, output, options=SegmentsOptions(**keys | {"segmenter": "classical"}))
    segments = open_artifact(output, SEGMENTS)
    labels, levels = segments.read("labels"), segments.read("instances/level")
    assert labels.shape == (COUNT, 3, SIDE, SIDE) and segments.origin == "synthetic"
    assert (labels[:, :, :2] == -1).all() and labels.max() < len(levels)
    for level in range(3):
        used = np.unique(labels[:, level])
        assert set(levels[used[used >= 0]]) == {level}
    # Each square keeps its own id through the video.
    whole = labels[:, 2]
    red = {int(whole[frame, 20, 14 + 3 * frame]) for frame in range(COUNT)}
    blue = {int(whole[frame, 50, 50 - 2 * frame]) for frame in range(COUNT)}
    assert len(red) == len(blue) == 1 and red != blue and min(red | blue) >= 0
    assert segments.facts["levels"] == ["subpart", "part", "whole"]
    assert sum(segments.facts["instances"].values()) == len(levels)


def test_frames_that_a_survey_drops_are_skipped(frames, tmp_path, keys, survey_that_keeps):
    """The kept frames are segmented as a video of their own; dropped frames have no label."""
    survey, output = survey_that_keeps(tmp_path, [1, 2, 5]), tmp_path / "segments.zarr"
    seen = []

    def look(video):
        seen.extend(int(video.image(place)[20, :, 0].argmax()) for place in range(video.length))
        labels = LabelMaps((3, SIDE, SIDE))
        for place in range(video.length):
            labels[place] = np.full((3, SIDE, SIDE), 0, np.int32)
        return Segmented(labels, [Track(0, 1, 1.0, 1.0)], [], [0, 2])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage, "segment_video", look)
        stage.run(
            frames, output, survey_path=survey, options=SegmentsOptions(**keys | {"segmenter": "classical"})
        )
    segments = open_artifact(output, SEGMENTS)
    assert seen == [4 + 3 * frame for frame in (1, 2, 5)]
    labels = segments.read("labels")
    assert (labels[[0, 3, 4]] == -1).all() and (labels[[1, 2, 5]] == 0).all()
    assert segments.read("instances/first_frame").tolist() == [2]
    assert segments.facts["key_frames"] == [1, 5]
    assert "kept_frames" in segments.provenance["options"]


def test_duplicates_are_merged_and_fragments_dropped(frames, tmp_path, keys, monkeypatch):
    labels = LabelMaps((3, SIDE, SIDE))
    for frame in range(COUNT):
        labels[frame] = np.full((3, SIDE, SIDE), -1, np.int32)
        changed = labels[frame]
        changed[0, 10:20] = 0 if frame < 3 else 2
        changed[1, 30:40] = 1 if frame == 4 else -1
        changed[2, 50:] = 3
        labels[frame] = changed
    instances = [
        Track(0, 0, 0.9, 0.95),
        Track(1, 4, 0.8, 0.9),
        Track(0, 3, 0.7, 0.9),
        Track(2, 0, 0.6, 0.8),
    ]
    segmented = Segmented(labels, instances, [(0, 2)], [])
    monkeypatch.setattr(stage, "segment_video", lambda *_: segmented)
    output = tmp_path / "segments.zarr"
    stage.run(frames, output, options=SegmentsOptions(**keys | {"segmenter": "classical", "min_frames": 3}))
    segments = open_artifact(output, SEGMENTS)
    found = segments.read("labels")
    assert (found[:, 0, 10:20] == 0).all() and (found[:, 1] == -1).all() and (found[:, 2, 50:] == 1).all()
    assert segments.read("instances/level").tolist() == [0, 2]
    assert segments.read("instances/predicted_iou").tolist() == pytest.approx([0.9, 0.6])
    assert segments.facts["merged"] == 1 and segments.facts["found"] == 4


def test_coverage_counts_shown_pixels_frames_and_instances(frames, tmp_path, keys, monkeypatch):
    """Two rows do not show the scene; instance 0 covers half of the others in one frame."""
    labels = LabelMaps((3, SIDE, SIDE))
    labels.leave_empty(range(COUNT))
    half = labels[0]
    half[0, :33] = 0
    labels[0] = half
    found = Segmented(labels, [Track(0, 0, 1.0, 1.0)], [], [])
    monkeypatch.setattr(stage, "segment_video", lambda _: found)
    output, options = tmp_path / "segments.zarr", SegmentsOptions(**keys | {"segmenter": "classical"})
    stage.run(frames, output, options=options.change(min_frames=1))
    facts = open_artifact(output, SEGMENTS).facts
    assert facts["pixels_without_instance"] == (2 * COUNT - 1) / (2 * COUNT)
    assert facts["instances_per_frame"] == 1 / COUNT and facts["frames_per_instance"] == 1.0


def test_no_instances_are_an_error_and_write_nothing(frames, tmp_path, keys, monkeypatch):
    labels = LabelMaps((3, SIDE, SIDE))
    for frame in range(COUNT):
        labels[frame] = np.full((3, SIDE, SIDE), -1, np.int32)
    monkeypatch.setattr(stage, "segment_video", lambda *_: Segmented(labels, [], [], []))
    with pytest.raises(UserError, match="segments.points_per_side"):
        stage.run(
            frames, tmp_path / "segments.zarr", options=SegmentsOptions(**keys | {"segmenter": "classical"})
        )
    assert not (tmp_path / "segments.zarr").exists()


def test_a_missing_checkpoint_is_reported_before_anything_is_read(frames, tmp_path, keys):
    with pytest.raises(UserError, match="sam2_checkpoint"):
        stage.run(
            frames,
            tmp_path / "segments.zarr",
            options=SegmentsOptions(**keys | {"sam2_checkpoint": str(tmp_path / "none.pt")}),
        )
