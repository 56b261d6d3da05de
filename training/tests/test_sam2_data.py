"""Training samples of SAM2: prompts, tracks and cuts agree with the labels."""

import numpy as np
import pytest
import torch

from training.small_models.sam2_data import (
    COARSE,
    FINE,
    SIDE,
    Clip,
    _piece_weights,
    perimeters,
    sample_clip,
    sample_prompts,
    sample_tracks,
    share_covered,
    vocabulary,
)
from training.small_models.worlds import NOTHING, RenderedWorld


@pytest.fixture
def world():
    """A grid of 6 x 6 subparts that moves to the right, four to a part, and nothing in the upper left corner.

    A subpart's number is its color.
    """
    rows, columns = np.indices((96, 96)) // 16
    subpart = np.stack([np.roll(rows * 6 + columns, 3 * frame, axis=1) for frame in range(4)])[None].astype(
        np.uint16
    )
    subpart[..., :10, :10] = NOTHING
    rgb = np.repeat(np.where(subpart == NOTHING, 0, 40 + 5 * subpart)[..., None], 3, axis=-1).astype(np.uint8)
    part = np.arange(36) // 2
    tables = np.stack([np.arange(36), part, part // 2])
    tables = np.pad(tables, ((0, 0), (0, 1)), constant_values=-1).astype(np.int32)
    return RenderedWorld(
        rgb, subpart, tables, tuple("abcdefghi"), tuple(f"{name} 1" for name in "mnopqrstuvwxyzabcd")
    )


def test_the_cut_is_the_same_in_all_frames_images_and_labels(world):
    rng = np.random.default_rng(0)
    # Parts have the names m, n, ... z, a, ... d; words are numbered alphabetically.
    names = np.append((np.arange(18) + 4) % 18, -1)
    for _ in range(20):
        clip = sample_clip([world], vocabulary([world]), rng, 3)
        assert clip.pictures.shape == (3, SIDE, SIDE, 3) and clip.labels.shape == (3, 3, SIDE, SIDE)
        assert np.array_equal(clip.names, names[clip.labels[1]])
        # One color per subpart, except at smoothed edges: medians differ between subparts, not within one.
        values = [value for value in np.unique(clip.labels[0]) if value >= 0]
        for value in values:
            colors = [
                np.median(clip.pictures[frame][clip.labels[0, frame] == value].astype(float), axis=0)
                for frame in range(3)
                if (clip.labels[0, frame] == value).sum() > 200
            ]
            assert np.ptp(colors, axis=0).max() < 6 if len(colors) > 1 else True


def test_targets_of_a_prompt_are_the_masks_under_the_point(world):
    rng = np.random.default_rng(1)
    labels = world.labels(np.repeat(np.repeat(world.subpart[0, 0], 2, 0), 2, 1))
    labels = np.pad(labels, ((0, 0), (32, 32), (32, 32)), constant_values=-1)
    prompts = sample_prompts(labels, rng, 60)
    side = labels.shape[-1] // COARSE
    assert prompts.coarse.shape == (60, 3, side, side) and prompts.fine.shape[-1] == labels.shape[-1] // FINE
    for number in range(60):
        x, y = (prompts.points[number] - 0.5).int().tolist()
        values = labels[:, y, x]
        assert bool(prompts.present[number]) == (values[0] >= 0)
        for level in range(3):
            expected = (labels[level] == values[level]) & (values[level] >= 0)
            share = expected.reshape(side, COARSE, side, COARSE).mean((1, 3))
            assert np.abs(prompts.coarse[number, level].numpy() - share).max() < 0.005
    assert 0 < (~prompts.present).sum() < 30


def test_thin_pieces_are_prompted_more_often_and_tiny_ones_less():
    labels = np.full((200, 200), -1, np.int32)
    labels[20:60, 20:60] = 0  # a square
    labels[80:90, 20:180] = 1  # a bar of the same area
    labels[100:110, 20:30] = 2  # a small square
    labels[120:124, 20:24] = 3  # below 0.1 % of the image
    labels[0, 0] = 4  # too small to be prompted
    assert perimeters(labels).tolist() == [160, 340, 40, 16, 2]
    weights = _piece_weights(labels)
    np.testing.assert_allclose(weights / weights[0], [1, 340 / 160, 1, 0.4, 0])
    assert weights.sum() == pytest.approx(1)
    assert not _piece_weights(np.full((8, 8), -1, np.int32)).any()


def test_targets_of_tracks_are_the_masks_of_later_frames(world):
    rng = np.random.default_rng(2)
    hidden = 0
    for _ in range(20):
        clip = sample_clip([world], vocabulary([world]), rng, 4)
        before = Clip(clip.pictures.copy(), clip.labels.copy(), clip.names.copy())
        tracks = sample_tracks(clip, rng, 5)
        count = tracks.prompt.shape[0]
        assert tracks.prompt.shape == (count, 1, SIDE, SIDE)
        assert tracks.coarse.shape == (4, count, SIDE // COARSE, SIDE // COARSE)
        assert tracks.present[0].all(), "tracked objects are visible in the first frame"
        assert (tracks.prompt.sum((1, 2, 3)) > 0).all()
        # Prompts are close to the true masks.
        given = torch.from_numpy(share_covered(tracks.prompt[:, 0].numpy() > 0, COARSE))
        assert ((given - tracks.coarse[0]).abs().mean((1, 2)) < 0.05).all()
        covered = (clip.labels == -1) & (before.labels >= 0)
        hidden += bool(covered.any())
        assert not covered[:, 0].any(), "the first frame is not covered"
        untouched = ~covered.any(axis=0)
        assert np.array_equal(clip.pictures[untouched], before.pictures[untouched])
    assert 2 < hidden < 20
