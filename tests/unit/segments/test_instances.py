"""Merging of duplicate instances, dropping of short ones, and the label maps drawn from logits."""

import numpy as np
import pytest
import torch

from egosplat.segments.instances import Overlaps, Segmented, Track, finalize_instances, merge_roots
from egosplat.segments.label_maps import LabelMaps, paint
from egosplat.segments.nms import union


def masks(*columns: tuple[int, int]) -> torch.Tensor:
    found = torch.zeros(len(columns), 8, 20, dtype=torch.bool)
    for mask, (first, last) in zip(found, columns, strict=True):
        mask[:, first:last] = True
    return found


def test_instances_that_overlap_in_their_common_frames_are_the_same():
    overlaps = Overlaps()
    overlaps.add([0, 1], masks((0, 10), (12, 20)))
    overlaps.add([0, 1, 4], masks((0, 10), (12, 20), (1, 10)))
    overlaps.add([0, 4], masks((0, 10), (0, 9)))
    # A frame in which one of them is not visible does not count.
    overlaps.add([0, 4], masks((0, 0), (0, 9)))
    assert overlaps.same(0.8, 4) == [(0, 4)]
    assert overlaps.same(0.95, 4) == []


def test_one_common_frame_suffices_only_in_a_video_of_one_frame():
    overlaps = Overlaps()
    overlaps.add([0, 1], masks((0, 10), (0, 10)))
    overlaps.add([], torch.zeros(0, 8, 20, dtype=torch.bool))
    assert overlaps.same(0.5, 30) == [] and overlaps.same(0.5, 1) == [(0, 1)]


def test_only_pairs_between_two_sets_are_counted():
    overlaps = Overlaps()
    for _ in range(2):
        overlaps.add_between([5, 6], masks((0, 10), (0, 10)), [0, 2], masks((0, 9), (15, 20)))
    assert overlaps.same(0.5, 10) == [(0, 5), (0, 6)], "the pair 5, 6 is within one set"


def test_merging_is_transitive():
    assert merge_roots(6, [(0, 4), (4, 2), (1, 5)]).tolist() == [0, 1, 0, 3, 0, 1]
    assert merge_roots(3, []).tolist() == [0, 1, 2] and merge_roots(0, []).tolist() == []


@pytest.mark.parametrize(
    ("frames", "table", "kept", "merged"),
    [
        # 0 and 2 are one; 1 is seen in a single frame.
        ([[0, 3], [2, 3], [0, 1], [3, -1]], [0, -1, 0, 1, -1], [0, 3], 1),
        # In a video of two frames, two suffice.
        ([[0, 3], [2, 3]], [0, -1, 0, 1, -1], [0, 3], 1),
        ([[2, 2], [0, 2]], [0, -1, 0, -1, -1], [0], 1),
    ],
)
def test_duplicates_are_merged_and_briefly_seen_instances_dropped(frames, table, kept, merged):
    labels = LabelMaps((1, 1, 2))
    for number, row in enumerate(frames):
        labels[number] = np.array([[row]], np.int32)
    found = finalize_instances(Segmented(labels, [Track(0, 0, 1.0, 1.0)] * 4, [(0, 2)], []), 3)
    assert (found.table.tolist(), found.kept.tolist(), found.merged) == (table, kept, merged)


def test_a_video_without_instances_keeps_none():
    labels = LabelMaps((1, 1, 2))
    labels.leave_empty([0])
    found = finalize_instances(Segmented(labels, [], [], []), 3)
    assert (found.table.tolist(), found.kept.tolist(), found.merged) == ([-1], [], 0)


def test_label_maps_are_restored_unchanged():
    labels = LabelMaps((2, 3, 4))
    given = np.arange(24, dtype=np.int32).reshape(2, 3, 4) - 1
    labels[1], labels[0] = given, given * 0 - 1
    assert len(labels) == 2 and np.array_equal(labels[1], given)
    changed = labels[1]
    changed[:] = 7
    assert np.array_equal(labels[1], given), "reading returns a copy"


def test_the_highest_logit_gets_the_pixel():
    logits = torch.full((3, 4, 4), -3.0)
    logits[0, :, :2], logits[1, :, 1:3] = 2.0, 4.0
    valid = np.ones((8, 8), bool)
    valid[0] = False
    found = paint([([7, 9], logits[:2]), ([3], logits[2:])], valid, torch.device("cpu"))
    assert (
        (found[0] == -1).all()
        and (found[1:, 0] == 7).all()
        and (found[1:, 4] == 9).all()
        and (found[:, -1] == -1).all()
    )
    assert (paint([], valid, torch.device("cpu")) == -1).all()


def test_union_of_no_masks_is_empty():
    assert not union(masks()).any() and union(masks((0, 3), (5, 6))).sum() == 32
