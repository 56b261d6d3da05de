"""Merging of duplicate instances, dropping of short ones, and the label maps drawn from logits."""

import numpy as np
import torch

from egosplat.segments.instances import Overlaps, frames_seen, merge_roots, number_kept
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


def test_briefly_seen_instances_are_dropped():
    roots = np.array([0, 1, 0, 3])
    new, staying = number_kept(roots, np.array([5, 2, 0, 3]), 3, 10)
    assert new.tolist() == [0, -1, 0, 1] and staying.tolist() == [0, 3]
    new, staying = number_kept(roots, np.array([2, 1, 0, 2]), 3, 2)
    assert staying.tolist() == [0, 3], "in a video of two frames, two suffice"
    assert number_kept(np.zeros(0, np.int64), np.zeros(0, np.int64), 3, 5)[1].tolist() == []


def test_label_maps_are_restored_unchanged():
    labels = LabelMaps((2, 3, 4))
    given = np.arange(24, dtype=np.int32).reshape(2, 3, 4) - 1
    labels[1], labels[0] = given, given * 0 - 1
    assert len(labels) == 2 and np.array_equal(labels[1], given)
    changed = labels[1]
    changed[:] = 7
    assert np.array_equal(labels[1], given), "reading returns a copy"


def test_frames_seen_counts_merged_instances_together():
    labels = LabelMaps((1, 1, 4))
    labels[0], labels[1] = np.array([[[0, 2, -1, -1]]], np.int32), np.array([[[2, 2, 1, -1]]], np.int32)
    assert frames_seen(labels, np.array([0, 1, 0])).tolist() == [2, 1, 0]


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
