"""Masks and weights at the extremes: nothing seen, nothing held, everything held, and weights that vanish."""

import numpy as np
import pytest

from egosplat.instances.things import beliefs, find_things
from tests.unit.instances.conftest import lifted

LEFT, RIGHT = [0, 1, 2, 3], [4, 5, 6]
ALL = [*LEFT, *RIGHT]


def merged(masks):
    """Thing of each mask, and (N, K) beliefs of the things."""
    thing, counts = find_things(masks, masks.weight)
    assert counts["things"] == len(set(thing[thing >= 0].tolist()))
    return thing.tolist(), beliefs(masks, thing).toarray()


@pytest.mark.numerics(
    "frame that sees no Gaussian, alone or among others", outside="its masks belong to no instance"
)
def test_nothing_seen():
    masks = lifted([LEFT, LEFT, LEFT, RIGHT], [0, 1, 2, 2], [ALL] * 3, instance=[0, 0, 0, 1])
    masks.seen.data[masks.seen.indptr[1] : masks.seen.indptr[2]] = 0.0
    masks.votes.data[masks.votes.indptr[1] : masks.votes.indptr[2]] = 0.0
    thing, held = merged(masks)
    assert [thing[0], thing[1], thing[3]] == [thing[2], -1, 1 - thing[2]] and np.isfinite(held).all()
    masks.seen.data[:] = 0.0
    masks.votes.data[:] = 0.0
    thing, held = merged(masks)
    assert thing == [-1] * 4 and not held.any()


@pytest.mark.numerics(
    "compositing weights of 1e-45 to 1e30 px", within=1e-6, outside="below 0.25 px: masks have no Gaussian"
)
@pytest.mark.parametrize("exponent", [-45, -38, -20, -3, 0, 10, 30])
def test_any_weight(measured, exponent):
    masks = lifted([LEFT, RIGHT] * 3, [0, 0, 1, 1, 2, 2], [ALL] * 3)
    size = np.float32(10.0**exponent)
    masks.seen.data[:] *= size
    masks.votes.data[:] *= size
    thing, held = merged(masks)
    assert thing == ([0, 1] * 3 if size >= 1.0 else [-1] * 6)
    expected = np.array([[1, 0]] * 4 + [[0, 1]] * 3) if size >= 1.0 else np.zeros((7, 0))
    measured(np.abs(held - expected).max(initial=0.0))


@pytest.mark.numerics("votes of 1e-6 of a Gaussian's weight", outside="Gaussian not in the mask")
def test_weights_that_vanish():
    masks = lifted([LEFT, RIGHT, LEFT], [0, 0, 1], [ALL] * 2)
    masks.votes.data[masks.votes.indptr[2] :] *= 1e-6
    thing, held = merged(masks)
    assert thing == [0, 1, -1] and np.isfinite(held).all()


@pytest.mark.numerics(
    "one frame, with one mask or three",
    within=0.0,
    outside="each mask is an instance, with a third of the belief",
)
@pytest.mark.parametrize("held", [[LEFT], [LEFT[:2], LEFT[2:], RIGHT]])
def test_one_frame(measured, held):
    thing, shares = merged(lifted(held, [0] * len(held), [ALL]))
    assert thing == list(range(len(held)))
    measured(np.abs(3 * shares - [[gaussian in mask for mask in held] for gaussian in ALL]).max())


@pytest.mark.numerics(
    "mask of all Gaussians: in one of four frames with two masks each; in every frame",
    outside="dropped; the only instance",
)
def test_a_mask_of_everything(monkeypatch):
    assert merged(lifted([ALL] * 5, list(range(5)), [ALL] * 5))[0] == [0] * 5
    masks = lifted([LEFT, RIGHT, LEFT, RIGHT, ALL, LEFT, RIGHT], [0, 0, 1, 1, 2, 3, 3], [ALL] * 4)
    monkeypatch.setattr("egosplat.instances.merging.MERGE_IOU", 0.6)
    thing, held = merged(masks)
    assert thing == [0, 1, 0, 1, -1, 0, 1] and held.max() == 1.0


@pytest.mark.numerics("200 identical masks, one a frame", within=1e-6, outside="one instance")
def test_identical_masks(measured):
    masks = lifted([LEFT] * 200, list(range(200)), [ALL] * 200, instance=[0] * 200)
    thing, held = merged(masks)
    assert thing == [0] * 200
    measured(np.abs(held[:, 0] - [1, 1, 1, 1, 0, 0, 0]).max())


@pytest.mark.numerics("masks without a Gaussian: all, or one of two", outside="they belong to no instance")
def test_empty_masks():
    assert merged(lifted([[], []], [0, 1], [ALL] * 2))[0] == [-1, -1]
    assert merged(lifted([LEFT, []], [0, 1], [ALL] * 2))[0] == [0, -1]
