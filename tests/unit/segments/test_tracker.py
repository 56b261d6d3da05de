"""Tracking of a video with random weights: prompts, ids and levels, both directions, limits, resuming."""

import numpy as np
import pytest
import torch

from egosplat.compute import choose_compute
from egosplat.models.point_decoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments import prompts as prompting
from egosplat.segments import tracker as tracking
from egosplat.segments import video as video_module
from egosplat.segments.masks import Candidates, intersections
from egosplat.segments.options import LEVELS, MASK_FILTERS, MaskFilter
from egosplat.segments.prompts import grid_points, prompt
from egosplat.segments.propagation import Group
from egosplat.segments.tracker import Tracker
from tests.unit.segments.conftest import HEIGHT, OPTIONS, VALID, WIDTH, video_of

OPTIONS = OPTIONS.change(max_instances=6, prompting="initial_frame")
FRAMES = 4
pytestmark = pytest.mark.usefixtures("all_masks")


@pytest.fixture(scope="module")
def images(images):
    return images[:FRAMES]


def tracked(sam2, images, options=OPTIONS, shown=None, prompted=(0, 2)):
    """What a run finds, and the frames that it reads."""
    asked: list[int] = []
    video = video_of(images, asked, (lambda _: VALID) if shown is None else shown.__getitem__)
    return Tracker(sam2, video, options, prompted=prompted).run(), asked


def test_a_video_is_tracked_in_bfloat16_as_on_a_gpu(sam2, images, monkeypatch):
    """Pixel counts in filters and merging stay exact under autocast: bfloat16 rounds those above 256."""
    half, largest = Sam2(sam2.video_predictor, choose_compute("cpu", "bfloat16")), [0]

    def watched(first, second):
        shared = intersections(first, second)
        assert torch.equal(shared, (first[:, None] & second[None]).flatten(2).sum(2).float())
        largest.append(int(shared.max()) if shared.numel() else 0)
        return shared

    monkeypatch.setattr(video_module, "intersections", watched)
    segmented, _ = tracked(half, images[:3])
    assert {one.level for one in segmented.instances} == set(range(len(LEVELS))) and max(largest) > 256


def test_instances_belong_to_one_level_and_labels_to_instances(sam2, images):
    segmented, asked = tracked(sam2, images)
    assert asked[:FRAMES] == list(range(FRAMES)), "the forward pass reads each frame once"
    for frame in range(FRAMES):
        for level, labels in enumerate(segmented.labels[frame]):
            numbers = np.unique(labels[labels >= 0])
            assert len(numbers) and {segmented.instances[number].level for number in numbers} == {level}
    assert {one.first_frame for one in segmented.instances} <= {0, 2} and segmented.prompted[0] == 0
    segmented, asked = tracked(sam2, images, prompted=[0])
    assert {one.first_frame for one in segmented.instances} == {0} and segmented.prompted == [0]
    assert asked == list(range(FRAMES)), "nothing is tracked backwards"


@pytest.mark.parametrize("found", ["_forwards", "_backwards"])
def test_a_track_of_what_another_follows_ends_in_both_directions(sam2, images, monkeypatch, found):
    tracker = Tracker(sam2, video_of(images), OPTIONS)
    group = Group([0, 7, 3], 0, torch.zeros(1), {}, torch.zeros(3))
    left, right = torch.zeros(2, 8, 8, dtype=torch.bool)
    left[:, :4], right[:, 4:] = True, True
    for _ in range(video_module.MIN_COMMON_FRAMES):
        tracker._overlaps[2].add(([0, 7, 3], torch.stack([left, right, left])))
    tracker._groups[2] = [group]
    monkeypatch.setattr(tracker, "_propagated", lambda frame, reverse: [([0], torch.zeros(1, 64, 64))] * 3)
    monkeypatch.setattr(tracker, "_add_new_tracks", lambda *_: None)
    getattr(tracker, found)(0)
    for _ in ("forwards", "backwards"):
        assert group.unseen.tolist() == [0, 0, np.inf]
        group.restart()
    new = Candidates(torch.ones(5, 64, 64), torch.ones(5), torch.ones(5))
    with sam2.compute.inference():
        begun, _ = tracker._begin(0, 2, new, [], new.logits[:0])
    assert len(begun) == OPTIONS.max_instances - 2, "it leaves room for another"


def test_the_number_of_tracked_instances_is_limited_and_may_be_none(sam2, images, monkeypatch):
    for most in (1, 3):
        found, _ = tracked(sam2, images, options=OPTIONS.change(max_instances=most))
        assert max(np.bincount([one.level for one in found.instances])) <= most
    monkeypatch.setitem(MASK_FILTERS, "auto", MaskFilter(1.0, 0.0, 0.1, 0.0))
    segmented, _ = tracked(sam2, images)
    assert segmented.instances == [] and segmented.same == []
    assert all((segmented.labels[frame] == -1).all() for frame in range(FRAMES))


def test_masks_do_not_depend_on_how_many_points_share_a_batch(sam2, images, monkeypatch):
    with sam2.compute.inference():
        encoded = encode(sam2, images[0])
        found = prompt(sam2, encoded, grid_points(6), OPTIONS)
        monkeypatch.setattr(prompting, "_PIXELS_A_BATCH_ON_CPU", 36 * 256)
        together = prompt(sam2, encoded, grid_points(6), OPTIONS)
    assert all(len(one) for one in found)
    for one, other in zip(found, together, strict=True):
        torch.testing.assert_close(one.logits, other.logits)
        torch.testing.assert_close(one.scores, other.scores)


def test_pixels_that_a_frame_leaves_out_are_neither_prompted_nor_labeled(sam2, images, monkeypatch):
    """Frame 0 shows nothing, frame 2 its left half; the tracks go on behind the masks of frame 3."""
    shown = np.ones((FRAMES, HEIGHT, WIDTH), bool)
    shown[0], shown[2, :, 28:], shown[3, :20] = False, False, False
    asked = []
    recorded = lambda sam2, encoded, points, *more: (
        asked.append(points) or prompt(sam2, encoded, points, *more)
    )
    monkeypatch.setattr(tracking, "prompt", recorded)
    found, _ = tracked(sam2, images, shown=shown)
    assert found.prompted == [2] and float(asked[0][:, 0].max()) < 0.5
    for frame in range(FRAMES):
        assert (found.labels[frame][:, ~shown[frame]] == -1).all()
    assert (found.labels[3][:, 20:] >= 0).any()
