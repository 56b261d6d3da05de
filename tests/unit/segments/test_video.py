"""Merging of duplicate instances, dropping of short ones, and label maps in memory and in checkpoints."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import UnusableState
from egosplat.segments.masks import paint
from egosplat.segments.video import LabelMaps, Overlaps, Segmented, Track, finalize_instances


def masks(*columns: tuple[int, int]) -> torch.Tensor:
    found = torch.zeros(len(columns), 8, 20, dtype=torch.bool)
    for mask, (first, last) in zip(found, columns, strict=True):
        mask[:, first:last] = True
    return found


def overlaps(*frames: dict[int, tuple[int, int]]) -> Overlaps:
    """Instances by number, each with its columns in a frame."""
    found = Overlaps()
    for seen in frames:
        found.add(([*seen], masks(*seen.values())))
    return found


def test_instances_that_overlap_in_their_common_frames_are_the_same():
    found = overlaps(
        {0: (0, 10), 1: (12, 20)},
        {0: (0, 10), 1: (12, 20), 4: (1, 10), 5: (0, 6)},
        {0: (0, 10), 4: (0, 9), 5: (0, 6)},
        {0: (0, 0), 4: (0, 9)},
    )
    assert found.same(4) == [(0, 4)]


def test_pairs_within_a_set_are_not_counted_between_two_sets():
    found, later, earlier = Overlaps(), ([5, 6], masks((0, 10), (0, 10))), ([0, 2], masks((0, 9), (15, 20)))
    for _ in range(2):
        found.add(later, earlier)
    assert found.same(10) == [(0, 5), (0, 6)]


@pytest.mark.parametrize(
    ("frames", "same", "table", "kept", "merged"),
    [
        # 0 and 2 are one; 1 is seen in a single frame.
        ([[0, 3], [2, 3], [0, 1], [3, -1]], [(0, 2)], [0, -1, 0, 1, -1], [0, 3], 1),
        # In a video of two frames, two suffice.
        ([[0, 3], [2, 3]], [(0, 2)], [0, -1, 0, 1, -1], [0, 3], 1),
        ([[2, 2], [0, 2]], [(0, 2)], [0, -1, 0, -1, -1], [0], 1),
        # Transitive: 0 and 3 by way of 2.
        ([[0, 1], [2, 1], [3, 1]], [(0, 2), (2, 3)], [0, 1, 0, 0, -1], [0, 1], 2),
        ([[-1, -1]], [], [-1] * 5, [], 0),
        ([[-1, -1]], [], [-1], [], 0),
    ],
)
def test_duplicates_are_merged_and_briefly_seen_instances_dropped(frames, same, table, kept, merged):
    labels = LabelMaps((len(frames), 1, 1, 2))
    for number, row in enumerate(frames):
        labels[number] = np.array([[row]], np.int32)
    found = finalize_instances(Segmented(labels, [Track(0, 0, 1.0, 1.0)] * (len(table) - 1), same, []), 3)
    assert [found[0].tolist(), found[1].tolist(), found[2]] == [table, kept, merged]


def test_label_maps_are_restored_unchanged():
    labels, given = LabelMaps((3, 2, 3, 4)), np.arange(24, dtype=np.int32).reshape(2, 3, 4) - 1
    labels[1] = given
    changed = labels[1]
    assert len(labels) == 3 and np.array_equal(changed, given) and (labels[2] == -1).all()
    changed[:] = 7
    assert np.array_equal(labels[1], given), "reading returns a copy"


def test_checkpoints_append_labels(tmp_path):
    """A killed run leaves files that no state names; the run that goes on from an older state writes them anew."""

    def opened(files: int) -> LabelMaps:
        labels = LabelMaps((3, 2, 3, 4))
        labels.load(tmp_path, files)
        return labels

    labels = LabelMaps((3, 2, 3, 4))
    labels[0], labels[1] = np.zeros((2, 3, 4)), np.ones((2, 3, 4))
    assert labels.save(tmp_path) == 1
    labels[1] = np.full((2, 3, 4), 7)
    assert labels.save(tmp_path) == 2
    for files, value in ((1, 1), (2, 7)):
        assert (opened(files)[1] == value).all() and (opened(files)[0] == 0).all()
    again = opened(1)
    again[2] = np.full((2, 3, 4), 9)
    newest = again.save(tmp_path)
    assert newest == 2 and (opened(newest)[1] == 1).all() and (opened(newest)[2] == 9).all()
    (tmp_path / "labels0").write_bytes(b"0" * 400)
    with pytest.raises(UnusableState):
        opened(newest)


def test_the_highest_logit_gets_the_pixel():
    logits = torch.full((3, 4, 4), -3.0)
    logits[0, :, :2], logits[1, :, 1:3] = 2.0, 4.0
    shown = np.ones((8, 8), bool)
    shown[0] = False
    found = paint([7, 9, 3], logits, shown)
    assert (found[0] == -1).all() and (found[1:, 0] == 7).all() and (found[1:, 4] == 9).all()
    assert (found[:, -1] == -1).all() and (paint([], logits[:0], shown) == -1).all()
