"""Propagation equals SAM2's own predictor, in bounded memory."""

import numpy as np
import pytest
import torch
from PIL import Image

from egosplat.models.point_decoder import encode
from egosplat.segments.propagation import Propagator

FRAMES = 5


@pytest.fixture(autouse=True)
def no_holes_are_filled(sam2, monkeypatch):
    monkeypatch.setattr(sam2.video_predictor, "hole_area", 0)


@pytest.fixture(scope="module")
def video():
    rng = np.random.default_rng(0)
    frames = np.repeat(rng.integers(0, 90, (1, 256, 256, 3), dtype=np.uint8), FRAMES, axis=0)
    for number, frame in enumerate(frames):
        frame[60:120, 40 + 8 * number : 100 + 8 * number] = (230, 40, 40)
    return frames


@pytest.fixture(scope="module")
def encoded(sam2, video):
    with sam2.compute.inference():
        return [encode(sam2, frame) for frame in video]


def logits() -> torch.Tensor:
    masks = torch.full((2, 64, 64), -10.0)
    masks[0, 15:30, 10:25] = 10.0
    masks[1, 40:60, 30:60] = 10.0
    return masks


def test_propagation_equals_sam2s_predictor(sam2, video, tmp_path):
    for number, frame in enumerate(video):
        Image.fromarray(frame).save(tmp_path / f"{number:03d}.jpg", quality=100, subsampling=0)
    predictor = sam2.video_predictor
    with sam2.compute.inference():
        state = predictor.init_state(str(tmp_path))
        for number, mask in enumerate(logits()):
            large = torch.nn.functional.interpolate(mask[None, None], (256, 256), mode="bilinear")[0, 0] > 0
            predictor.add_new_mask(state, 0, number, large)
        expected = {frame: state["output_dict_per_obj"] for frame, *_ in predictor.propagate_in_video(state)}
        images = [np.asarray(Image.open(tmp_path / f"{number:03d}.jpg")) for number in range(FRAMES)]
        propagator = Propagator(sam2, lambda frame: encode(sam2, images[frame]), FRAMES)
        group = propagator.begin(0, [0, 1], logits())
        for frame in range(1, FRAMES):
            found = propagator.step(frame, group, reverse=False)
            outputs = [expected[frame][number]["non_cond_frame_outputs"][frame] for number in (0, 1)]
            truth = torch.cat([output["pred_masks"][:, 0] for output in outputs])
            torch.testing.assert_close(found, truth, rtol=1e-3, atol=1e-3)


def test_backward_propagation_equals_forward_on_the_reversed_video(sam2, encoded):
    with sam2.compute.inference():
        forwards = Propagator(sam2, encoded[::-1].__getitem__, FRAMES)
        backwards = Propagator(sam2, encoded.__getitem__, FRAMES)
        ahead = forwards.begin(0, [0, 1], logits())
        back = backwards.begin(FRAMES - 1, [0, 1], logits())
        for step in range(1, FRAMES):
            one = forwards.step(step, ahead, reverse=False)
            other = backwards.step(FRAMES - 1 - step, back, reverse=True)
            torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)


def test_memory_does_not_grow(sam2, encoded):
    model = sam2.video_predictor
    with sam2.compute.inference():
        propagator = Propagator(sam2, lambda _: encoded[0], 20)
        group = propagator.begin(0, [0, 1], logits())
        for frame in range(1, 13):
            propagator.step(frame, group, reverse=False)
    held = [output for output in group.recent.values() if "maskmem_features" in output]
    assert len(held) == model.num_maskmem - 1 and len(group.recent) == model.max_obj_ptrs_in_encoder


@pytest.fixture
def steps(sam2, encoded, monkeypatch):
    """``steps(visible, last, **changes)``: what is searched in frames 1 to ``last``, what is seen, and whether tracking ended. Two
    objects are tracked, of which ``visible(object, frame)`` says whether they can be found."""

    def run(visible, last: int, **changes):
        searched: dict[int, list[int]] = {}
        seen: dict[int, list[bool]] = {}

        def track(self, frame, group, chosen, reverse):
            searched[frame] = chosen
            found = torch.tensor([10.0 if visible(each, frame) else -10.0 for each in chosen])
            memory = {name: values[chosen] for name, values in group.begun.items()}
            return found[:, None, None].expand(-1, 64, 64), memory

        monkeypatch.setattr(Propagator, "_track", track)
        with sam2.compute.inference():
            propagator = Propagator(sam2, lambda _: encoded[0], 20, **changes)
            group = propagator.begin(0, [0, 1], logits())
            for frame in range(1, last + 1):
                found = propagator.step(frame, group, reverse=False)
                seen[frame] = [bool((each > 0).any()) for each in found]
        assert bool(propagator.searched(group)) == bool(group.recent)
        return searched, seen, not propagator.searched(group)

    return run


def test_lost_objects_are_searched_only_every_stride_frames(steps):
    """Object 1 is lost after frame 2 and visible again from frame 7: it is found in the next searched frame."""
    searched, seen, _ = steps(lambda each, frame: each == 0 or not 2 < frame < 7, 10, lost_tracks_end=True)
    assert all(searched[frame] == [0, 1] for frame in (3, 4, 5)), "for three frames after it is lost"
    assert [frame for frame in (6, 7, 8, 9) if searched[frame] == [0, 1]] == [6, 9], "then every third frame"
    assert seen[8] == [True, False] and seen[9] == [True, True] and searched[10] == [0, 1]


@pytest.mark.parametrize(("ends", "frames"), [(True, [1, 2, 3, 6]), (False, [*range(1, 12)])])
def test_lost_objects_end_when_the_memory_does(steps, sam2, ends, frames):
    """An object that is lost from frame 1 on and visible again from frame 9 is found only if its track has no end."""
    assert sam2.video_predictor.max_obj_ptrs_in_encoder == 8
    searched, seen, ended = steps(lambda each, frame: frame >= 9, 11, lost_tracks_end=ends)
    assert [*searched] == frames and any(seen[11]) != ends and ended == ends


def test_absent_objects_do_not_change_the_tracked_ones(sam2, encoded):
    with sam2.compute.inference():
        propagator = Propagator(sam2, encoded.__getitem__, FRAMES, lost_tracks_end=True)
        both, alone = (propagator.begin(0, [0, 1][:count], logits()[:count]) for count in (2, 1))
        # The second object counts as lost: the first must be propagated as if alone.
        both.unseen = torch.tensor([0.0, 10.0])
        for frame in range(1, FRAMES):
            together = propagator.step(frame, both, reverse=False)
            single = propagator.step(frame, alone, reverse=False)
            torch.testing.assert_close(together[:1], single, rtol=1e-4, atol=1e-4)
            assert (together[1] < 0).all()
    assert both.unseen[1] == 10 + FRAMES - 1
