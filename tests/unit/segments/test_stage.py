"""The stage segments: its artifact for a small video, merging and dropping of instances, errors."""

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SEGMENTS
from egosplat.errors import UserError
from egosplat.segments import stage
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.video import LabelMaps, Segmented, Track
from tests.support.scenes import put

COUNT, SIDE = 6, 64


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


def test_classical_segments_of_moving_squares(frames, tmp_path):
    output = tmp_path / "segments.zarr"
    stage.run(frames, output, options=SegmentsOptions(segmenter="classical"))
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


@pytest.fixture
def segmented(frames, tmp_path, monkeypatch):
    """``segmented(labels, instances, ...)``: the artifact where the classical segmenter finds these labels of each frame."""

    def make(labels, instances, same=(), prompted=(), survey=None, min_frames=3, seen=None):
        def found(video):
            maps = LabelMaps((video.length, 3, SIDE, SIDE))
            for place in range(video.length):
                maps[place] = labels[place]
                if seen is not None:
                    seen.append(int(video.image(place)[20, :, 0].argmax()))
            return Segmented(maps, instances, list(same), list(prompted))

        monkeypatch.setattr(stage, "segment_video", found)
        options = SegmentsOptions(segmenter="classical", min_frames=min_frames)
        stage.run(frames, tmp_path / "segments.zarr", survey_path=survey, options=options)
        return open_artifact(tmp_path / "segments.zarr", SEGMENTS)

    return make


def nothing(count=COUNT) -> np.ndarray:
    return np.full((count, 3, SIDE, SIDE), -1, np.int32)


def test_frames_that_a_survey_drops_are_skipped(segmented, tmp_path, survey_that_keeps):
    survey, seen = survey_that_keeps(tmp_path, [1, 2, 5]), []
    instances = [Track(0, 1, 1.0, 1.0)]
    segments = segmented(nothing(3) + 1, instances, prompted=[0, 2], survey=survey, seen=seen)
    assert seen == [4 + 3 * frame for frame in (1, 2, 5)]
    labels = segments.read("labels")
    assert (labels[[0, 3, 4]] == -1).all() and (labels[[1, 2, 5]] == 0).all()
    assert segments.read("instances/first_frame").tolist() == [2]
    assert segments.facts["key_frames"] == [1, 5]
    assert "kept_frames" in segments.provenance["options"]


def test_duplicates_are_merged_and_fragments_dropped(segmented):
    labels = nothing()
    labels[:3, 0, 10:20], labels[3:, 0, 10:20], labels[4, 1, 30:40], labels[:, 2, 50:] = 0, 2, 1, 3
    about = (0, 0, 0.9, 0.95), (1, 4, 0.8, 0.9), (0, 3, 0.7, 0.9), (2, 0, 0.6, 0.8)
    segments = segmented(labels, [Track(*values) for values in about], [(0, 2)])
    found = segments.read("labels")
    assert (found[:, 0, 10:20] == 0).all() and (found[:, 1] == -1).all() and (found[:, 2, 50:] == 1).all()
    assert segments.read("instances/level").tolist() == [0, 2]
    assert segments.read("instances/predicted_iou").tolist() == pytest.approx([0.9, 0.6])
    assert segments.facts["merged"] == 1 and segments.facts["found"] == 4


def test_coverage_counts_shown_pixels_frames_and_instances(segmented):
    labels = nothing()
    labels[0, 0, :33] = 0
    facts = segmented(labels, [Track(0, 0, 1.0, 1.0)], min_frames=1).facts
    assert facts["pixels_without_instance"] == (2 * COUNT - 1) / (2 * COUNT)
    assert facts["instances_per_frame"] == 1 / COUNT and facts["frames_per_instance"] == 1.0


def test_no_instances_are_an_error_and_write_nothing(segmented, tmp_path):
    with pytest.raises(UserError, match="segments.points_per_side"):
        segmented(nothing(), [])
    assert not (tmp_path / "segments.zarr").exists()


def test_a_missing_checkpoint_is_reported_before_anything_is_read(frames, tmp_path):
    options = SegmentsOptions(sam2_checkpoint=str(tmp_path / "none.pt"))
    with pytest.raises(UserError, match="sam2_checkpoint"):
        stage.run(frames, tmp_path / "segments.zarr", options=options)


@pytest.mark.parametrize(("count", "stride", "step"), [(25, 8, 1), (33, 4, 2), (64, 4, 4), (0, 4, 1)])
def test_key_frames_are_sixteen_or_all_of_a_short_recording(count, stride, step):
    found = SegmentsOptions(key_frame_stride=stride).key_frames(np.arange(count))
    assert found.tolist() == list(range(0, count, step))
