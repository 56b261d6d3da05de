"""True tracks are broken as the page says, and written as artifacts that stages read."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.instances import broken_tracks
from benchmarks.instances.video_scores import score_level
from benchmarks.true_instances import __main__ as true_instances
from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import FRAMES, SCHEMAS
from tests.support.scenes import put

COUNT, SIZE = 3, 12


@pytest.fixture
def truth() -> list[np.ndarray]:
    """60 frames of three stripes, and a column without an instance."""
    stripes = np.repeat(np.arange(COUNT, dtype=np.int32), SIZE // COUNT)[:, None].repeat(SIZE, axis=1)
    stripes[:, -1] = -1
    return [stripes] * 60


def test_tracks_are_cut_into_pieces_and_swapped_in_some_frames(truth):
    """Outlines stay, names do not: each piece has its own, and two instances may have each other's."""
    broken = broken_tracks.break_tracks(truth, COUNT)
    swapped = 0
    for frame, (true, found) in enumerate(zip(truth, broken, strict=True)):
        assert np.array_equal(true < 0, found < 0)
        names = np.concatenate([np.unique(found[true == one]) for one in range(COUNT)])
        expected = frame // broken_tracks.CUT_EVERY * COUNT + np.arange(COUNT)
        assert np.array_equal(np.sort(names), expected)
        wrong = (names != expected).sum()
        assert wrong in (0, 2)
        swapped += wrong == 2
    assert 2 <= swapped <= 12
    again = broken_tracks.break_tracks(truth, COUNT)
    assert all(np.array_equal(one, other) for one, other in zip(broken, again, strict=True))
    assert score_level(zip(truth, broken, strict=True)).iou < 0.4


def test_outlines_get_the_name_of_the_thing_that_most_of_their_pixels_show(truth):
    things = np.full((SIZE, SIZE), 7, np.int32)
    things[:3], things[8:] = 5, -1
    renamed = broken_tracks.renamed(truth[0], things)
    assert [np.unique(renamed[truth[0] == one]).tolist() for one in range(COUNT)] == [[5], [7], [-1]]
    assert (renamed[truth[0] < 0] == -1).all()


def test_true_instances_become_complete_artifacts(tmp_path, truth, monkeypatch):
    """Segments for the stage instances, and instances for the stages after it."""
    valid = np.arange(SIZE) < SIZE - 2
    put(tmp_path, "frames", {"train": np.ones(60, bool), "valid": np.tile(valid, (SIZE, 1))})
    frames = open_artifact(tmp_path / "frames.zarr", FRAMES)
    broken_tracks.write_segments(tmp_path / "segments.zarr", frames, truth, np.arange(COUNT) == 1)
    segments = verify(tmp_path / "segments.zarr", SCHEMAS)
    assert np.array_equal(segments.read("labels")[:, 0], truth)
    assert segments.read("instances/moving").tolist() == [False, True, False]
    known = SimpleNamespace(names=["a", "b", "c"], all_labels=lambda: iter(truth))
    monkeypatch.setattr(true_instances, "read_truth", lambda *_: known)
    true_instances.write_true_instances(tmp_path, tmp_path / "instances.zarr")
    labels = verify(tmp_path / "instances.zarr", SCHEMAS).read("labels")[:, 0]
    assert np.array_equal(labels, np.where(valid, truth, -1))
