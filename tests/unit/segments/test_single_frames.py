"""Crops of a frame: where they lie, which of their masks are used, and where these land on the frame."""

import numpy as np
import pytest
import torch

from egosplat.segments import prompts, single_frames
from egosplat.segments.masks import Candidates
from egosplat.segments.options import MASK_FILTERS, MaskFilter, SegmentsOptions
from egosplat.segments.prompts import Bounds, prompt
from egosplat.segments.single_frames import crops_of, join_frames, segment_frame
from egosplat.segments.video import Video

SHAPE = (48, 64)


def candidates(masks):
    """Candidates with logits 1 inside (N, M, M) masks and -1 outside, and equal scores."""
    logits = torch.as_tensor(masks).float() * 2 - 1
    return Candidates(logits, torch.full((len(logits),), 0.9), torch.full((len(logits),), 0.9))


@pytest.mark.parametrize("per_side", [1, 2, 3, 4])
def test_crops_cover_the_frame_and_overlap(per_side):
    found = crops_of(480, 640, per_side)
    assert len(found) == per_side**2
    seen = np.zeros((480, 640), int)
    for crop in found:
        seen[crop] += 1
    assert seen.min() == 1 and (seen.max() > 1) == (per_side > 1)
    assert len({seen[crop].shape for crop in found}) == 1


def test_a_mask_lands_at_its_place_in_the_frame():
    crop, canvas = np.s_[12:44, 20:60], 128
    rows, columns = (np.arange(80) + 0.5) / 80 * 32 + 12, (np.arange(80) + 0.5) / 80 * 40 + 20
    disc = (rows[:, None] - 30) ** 2 + (columns[None] - 42) ** 2 < 9**2
    landed = single_frames._to_canvas(candidates(disc[None]), crop, SHAPE, canvas).masks[0].numpy()
    rows, columns = (np.arange(canvas) + 0.5) / canvas * 48, (np.arange(canvas) + 0.5) / canvas * 64
    true = (rows[:, None] - 30) ** 2 + (columns[None] - 42) ** 2 < 9**2
    assert (landed & true).sum() / (landed | true).sum() > 0.95


def test_masks_that_are_large_or_that_a_border_inside_the_frame_cuts_off_are_dropped():
    """A mask at the frame's own border stays; one at a crop's inner border goes, and one of more than a quarter."""
    masks = np.zeros((4, 40, 40), bool)
    masks[0, :4, 10:14] = True  # the frame's top border
    masks[1, 10:14, -4:] = True  # an inner border
    masks[2, 20:24, 20:24] = True  # inside
    masks[3, 5:30, 5:30] = True  # large
    # Of the crop at the frame's top left corner.
    bounds = Bounds(0.0, 0.25, single_frames._inner_border(np.s_[0:32, 0:40], SHAPE, 40, 2))
    assert prompts.within(torch.from_numpy(masks), bounds).tolist() == [True, False, True, False]


def test_what_is_clearly_inside_a_large_subpart_is_no_small_thing():
    """But near a dip of its logits, near its outline and in a small subpart something may be small."""
    masks, shown = np.zeros((2, 64, 64), bool), np.ones((64, 128), bool)
    masks[0, :, :30], masks[1, :16, 40:], shown[0] = True, True, False
    subparts = candidates(masks * 2)
    subparts.logits[0, 20, 10] = 0.5
    expected = shown[:, ::2].copy()
    expected[:, :29], expected[19:22, 9:12] = False, True
    assert np.array_equal(single_frames._may_be_small(subparts, shown, SegmentsOptions())[:, ::2], expected)


def test_a_mask_from_a_crop_replaces_the_same_mask_of_the_frame():
    coarse = np.zeros((2, 20, 20), bool)
    coarse[0, 4:8, 4:8] = True
    coarse[1, 10:18, 10:18] = True
    fine = np.zeros((1, 40, 40), bool)
    fine[0, 8:16, 8:16] = True
    merged = single_frames._merge(candidates(coarse), candidates(fine), 40, SegmentsOptions())
    assert len(merged) == 2
    assert torch.equal(merged.masks[0], torch.from_numpy(fine[0]))


IMAGE = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("columns", "small", "expected"),
    [(50, True, [96, 135, 0, 135, 0]), (50, False, [96] + [0] * 4), (0, True, [0] * 5)],
)
def test_a_frame_and_its_crops_are_prompted_where_masks_may_be(sam2, monkeypatch, columns, small, expected):
    """Less than the left half is shown, or nothing: crops on the right have no point there, and none has one at an inner
    border or where nothing small may be. The frame alone has the options' size; crops have the model's own, and it has that again afterwards."""
    shown, prompted = np.zeros((96, 128), bool), []
    shown[:, :columns] = True
    recorded = lambda *given: prompted.append(given[1:3]) or prompt(*given)
    monkeypatch.setattr(single_frames, "prompt", recorded)
    if not small:
        monkeypatch.setattr(single_frames, "_may_be_small", lambda _, shown, __: torch.zeros(shown.shape) > 0)
    monkeypatch.setitem(MASK_FILTERS, "auto", MaskFilter(-1.0, 0.0, 0.1, -1.0))
    options = SegmentsOptions(points_per_side=16, crops_per_side=2, image_size=512)
    state = segment_frame(sam2, Video(1, lambda _: IMAGE, lambda _: shown), 0, options)
    found = join_frames([state], [0], 1, (96, 128)).labels[0]
    assert [len(points) for _, points in prompted] == expected
    assert [one.sizes[0][0] * 4 for one, _ in prompted] == [512, *[256] * 4]
    assert sam2.video_predictor.image_size == 256 and (prompted[0][1][:, 0] < columns / 128).all()
    assert (found[:, :, columns:] == -1).all() and (found >= 0).any() == (columns > 0)
