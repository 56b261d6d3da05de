"""Regions that the network is sure of for several frames are masked without a track, and nothing else is."""

from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.transient import masks_stage
from egosplat.transient.sure_regions import find_regions, lasting_masks
from tests.support.scenes import put

SIZE, FRAME_COUNT, HELD_OUT = 32, 6, 3
NONE = np.zeros((SIZE, SIZE), bool)
EVERYWHERE = ~NONE
MEASURED = {
    "residual_scale": np.full(FRAME_COUNT, 0.01, np.float32),
    "compared": EVERYWHERE,
    "stands_out": np.ones((FRAME_COUNT, SIZE, SIZE), bool),
}


def square(row: int, column: int, side: int = 10) -> np.ndarray:
    mask = NONE.copy()
    mask[row : row + side, column : column + side] = True
    return mask


def is_most_of(found: np.ndarray, expected: np.ndarray) -> bool:
    """Whether these are the expected pixels but for corners, which a region does not have."""
    return bool(expected.any()) and not (found & ~expected).any() and found.sum() >= 0.85 * expected.sum()


HAND = np.stack([square(8, 4 + 2 * frame) for frame in range(FRAME_COUNT)])


def masked(scene, sure, made: dict[str, object], keys: dict[str, object] | None = None, **arrays: np.ndarray):
    """The refined masks where the network is sure of (6, 32, 32) pixels."""
    folder: Path = scene(made.get("facts"), **made.get("arrays", {}))
    probability = np.where(sure, 0.95, 0.0).astype(np.float16)
    put(folder, "transient", {"probability": probability} | MEASURED | arrays)
    inputs = (folder / f"{name}.zarr" for name in ("frames", "transient", "instances"))
    masks_stage.run(*inputs, folder / "masks.zarr", masks_stage.MasksOptions(**keys or {}))
    return verify(folder / "masks.zarr", SCHEMAS)


def instances(labels: np.ndarray, moving: bool, masks: int) -> dict[str, object]:
    """One instance with its (6, 32, 32) pixels: a track, or merged of a number of masks."""
    maps = np.full((FRAME_COUNT, 3, SIZE, SIZE), -1, np.int32)
    maps[:, 2][labels] = 0
    arrays = {
        "labels": maps,
        "instances/level": np.array([2], np.int8),
        "instances/masks": np.array([masks], np.int32),
        "instances/moving": np.array([moving]),
    }
    return {"facts": {"source": "masks"}, "arrays": arrays}


NO_INSTANCE = instances(np.zeros((FRAME_COUNT, SIZE, SIZE), bool), moving=True, masks=1)
PATCH = np.stack([square(8, 8)] * FRAME_COUNT)


def test_a_region_without_a_track_is_masked(scene):
    found = masked(scene, HAND, NO_INSTANCE)
    refined = found.read("refined")
    training = np.arange(FRAME_COUNT) != HELD_OUT
    assert is_most_of(refined[training], HAND[training])
    # The held-out frame decides nothing: it gets what its neighbors show and the network marks there.
    between = HAND[HELD_OUT] & (HAND[HELD_OUT - 1] | HAND[HELD_OUT + 1])
    assert is_most_of(refined[HELD_OUT], between)
    assert found.facts["masked_by_regions"] == pytest.approx(refined.mean()) and not found.facts["transient"]


def test_a_track_with_holes_is_filled(scene, monkeypatch):
    """The track is seen in frames 0 and 5 alone, as SAM2's tracks of real hands are."""
    monkeypatch.setattr(masks_stage, "MAX_SHARE", 1.0)
    seen = HAND & np.isin(np.arange(FRAME_COUNT), (0, 5))[:, None, None]
    made = instances(seen, moving=True, masks=2)
    refined = masked(scene, HAND, made).read("refined")
    assert all(is_most_of(refined[row], HAND[row]) for row in (0, 1, 2, 4, 5))
    alone = masked(scene, HAND, made, {"recipe": "paper"}).read("refined")
    assert (alone == seen).all()


@pytest.mark.parametrize("frames", [(2,), (1, 2), (0, 1), (0, 4)])
def test_a_region_of_fewer_than_three_frames_is_not_masked(scene, frames):
    sure = HAND & np.isin(np.arange(FRAME_COUNT), frames)[:, None, None]
    assert not masked(scene, sure, NO_INSTANCE).read("refined").any()


@pytest.mark.parametrize(
    ("side", "standing", "expected"), [(10, 0.9, True), (10, 0.5, False), (3, 1.0, False)]
)
def test_a_region_is_large_and_stands_out(scene, side, standing, expected):
    sure = np.stack([square(8, 8, side)] * FRAME_COUNT)
    stands_out = sure & (np.arange(SIZE) < 8 + standing * side)
    assert masked(scene, sure, NO_INSTANCE, stands_out=stands_out).read("refined").any() == expected


@pytest.mark.parametrize(("masks", "standing", "expected"), [(3, 0.7, False), (2, 0.7, True), (3, 0.9, True)])
def test_an_instance_that_holds_in_3d_explains_a_region(scene, masks, standing, expected):
    wall = np.ones((FRAME_COUNT, SIZE, SIZE), bool)
    stands_out = np.broadcast_to(np.arange(SIZE) < 8 + 10 * standing, wall.shape)
    made = instances(wall, moving=False, masks=masks)
    assert masked(scene, PATCH, made, stands_out=stands_out).read("refined").any() == expected


def test_an_instance_that_the_network_is_wrong_about_is_not_masked(scene):
    """A window that is merged in 3D, and that the network calls transient as a whole."""
    assert not masked(scene, PATCH, instances(PATCH, moving=False, masks=3)).read("refined").any()


@pytest.mark.parametrize(("columns", "expected"), [(10, True), (4, True), (3, False)])
def test_a_track_that_looks_static_is_not_masked(scene, monkeypatch, columns, expected):
    monkeypatch.setattr(masks_stage, "MAX_SHARE", 1.0)
    made, stands_out = instances(PATCH, moving=True, masks=1), PATCH & (np.arange(SIZE) < 8 + columns)
    found = masked(scene, PATCH, made, stands_out=stands_out)
    assert found.read("refined").any() == expected and not found.facts["withheld"]


def test_a_frame_between_two_has_a_mask():
    """Where the network marks nothing at all, it is what both neighbors mask."""
    rows = [0, 1, 2, 4, 5]
    regions = {row: find_regions(HAND[row], NONE, EVERYWHERE) for row in rows} | {3: np.zeros_like(NONE, int)}
    masks = lasting_masks(regions.__getitem__, regions)
    assert is_most_of(masks.mask(3, NONE, HAND[3]), HAND[3] & (HAND[2] | HAND[4]))
    assert is_most_of(masks.mask(3, NONE, NONE), HAND[2] & HAND[4])


def test_a_region_that_ends_beside_one_that_lasts_is_not_masked():
    """A region splits: the left half lasts, and the right half is seen once, after a frame without it."""
    wide, left, right = square(4, 2, 28), square(4, 2, 12), square(4, 18, 12)
    regions = dict(enumerate(np.array([wide, left, left + 2 * right], int)))
    masks = lasting_masks(regions.__getitem__, regions)
    assert [masks.mask(frame, EVERYWHERE, EVERYWHERE).sum() for frame in range(3)] == [784, 144, 144]
