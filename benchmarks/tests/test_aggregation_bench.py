"""Tracks are made wrong as far, and in the way, that is said."""

import numpy as np
import pytest

from benchmarks.aggregation.tracks import KINDS, Tracks, corrupted, slid

VIEWS = 10


@pytest.fixture
def tracks() -> Tracks:
    """Four things of two worlds; a feature says which thing it shows, and 9 where the mask slid off."""
    thing = np.repeat(np.arange(4), VIEWS)
    right = np.stack([thing, np.tile(np.arange(VIEWS), 4)], axis=1).astype(np.float32)
    wrong = np.full_like(right, 9)
    return Tracks(np.array([0, 0, 0, 1]), np.array(["cup", "book", "cup", "book"]), thing, right, wrong)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_the_given_share_of_views_is_corrupted(tracks, kind, share):
    found = corrupted(tracks, kind, share, np.random.default_rng(0))
    changed = (found != tracks.feature).any(axis=1).reshape(4, VIEWS).sum(axis=1)
    assert changed[:3].tolist() == [share * VIEWS] * 3
    assert changed[3] == (share * VIEWS if kind == "slid" else 0)  # alone in its world


@pytest.mark.parametrize("kind", ["switched", "scattered"])
def test_what_is_wrong_is_of_the_same_world_and_another_name(tracks, kind):
    found = corrupted(tracks, kind, 0.5, np.random.default_rng(0))[:, 0].reshape(4, VIEWS)
    assert set(found[0]) == {0, 1} and set(found[2]) == {2, 1}
    others = set(found[1]) - {1}
    assert len(others) == 1 if kind == "switched" else others == {0, 2}


@pytest.mark.parametrize("left, top", [(0, 0), (14, 0), (0, 9), (14, 9)])
def test_a_slid_mask_keeps_its_shape_and_stays_in_the_picture(left, top):
    labels = np.full((12, 20), -1, np.int32)
    labels[top : top + 3, left : left + 6] = 5
    labels[top, left] = -1
    moved, box = slid(labels, np.array([left, top, left + 6, top + 3]), 5)
    assert (moved == 5).sum() == 17 and not ((moved == 5) & (labels == 5)).any()
    x0, y0, x1, y1 = box
    assert (moved[y0:y1, x0:x1] == labels[top : top + 3, left : left + 6]).all()
