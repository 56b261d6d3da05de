"""Things have the outlines of their masks where they have some; a track stands still if its masks do."""

import numpy as np
import pytest

from egosplat.instances.merging import Runs
from egosplat.instances.moving import standing_tracks
from egosplat.instances.scene import draw_masks, keep_outlines
from tests.unit.instances.conftest import lifted


def labels(*rows: list[int]) -> np.ndarray:
    """(1, H, W) labels."""
    return np.array([rows], np.int32)


@pytest.mark.parametrize(("frame", "drawn"), [(0, 1), (3, 4), (1, -1)])
def test_a_mask_takes_the_name_of_its_thing_in_its_own_frame(frame, drawn):
    named = np.array([[0, 0, 3], [7, 2, 7], [1, -1, 4]])
    assert draw_masks(named, frame, labels([7, 2, -1, 5])).tolist() == [[[drawn, -1, -1, -1]]]


def test_a_mask_replaces_the_rendering_of_its_thing_and_of_what_it_covers():
    rendered, drawn = labels([0, 0, 0, 1, 1, 2]), labels([-1, 0, 0, 0, -1, -1])
    # Thing 0 ends where its mask ends; 1 and 2 have no mask, and stay where 0 is not.
    assert keep_outlines(rendered, drawn).tolist() == [[[-1, 0, 0, 0, 1, 2]]]


WALL = list(range(40))
# Four places that a person walks through.
PLACES = [WALL[start : start + 10] for start in (0, 10, 20, 30)]


def standing(held, seconds, seen=None, instance=None) -> list[int]:
    """The standing tracks; mask k is of frame k, and of track 0 unless ``instance`` says more."""
    count = len(held)
    masks = lifted(held, list(range(count)), seen or [WALL] * count, instance or [0] * count)
    return standing_tracks(masks, np.array(seconds, float)).tolist()


def elsewhere(count: int) -> list[list[int]]:
    return [WALL[10 + 4 * place : 14 + 4 * place] for place in range(count)]


HALVES = [WALL[start : start + 20] for start in (0, 5, 10, 15, 20)]


@pytest.mark.parametrize(
    ("held", "seconds", "more", "expected"),
    [
        # A wall and a person.
        ([PLACES[1]] * 4 + PLACES, [0, 1, 2, 3] * 2, {"instance": [7] * 4 + [9] * 4}, [7]),
        # Masks of the same moment are no evidence, and two are too few.
        ([PLACES[0]] * 4, [0.0, 0.2, 0.4, 0.6], {}, []),
        ([PLACES[0]] * 2, [0, 1], {}, []),
        ([PLACES[0]] * 3, [0, 1, 2], {}, [0]),
        # Each two neighboring frames share a half of the wall; the first and the last share nothing.
        (HALVES, range(5), {"seen": HALVES}, [0]),
        # Of ten masks, some are where it rests and each of the others is elsewhere.
        ([PLACES[0]] * 8 + elsewhere(2), range(10), {}, [0]),
        ([PLACES[0]] * 3 + elsewhere(7), range(10), {}, []),
    ],
)
def test_a_thing_stands_if_most_pairs_of_its_masks_do(held, seconds, more, expected):
    assert standing(held, seconds, **more) == expected


def test_the_time_does_not_grow_with_the_square_of_the_frames(monkeypatch):
    counts, compare = [], Runs.overlaps
    counted = lambda runs, one, others: counts.append(len(others)) or compare(runs, one, others)
    monkeypatch.setattr(Runs, "overlaps", counted)
    assert standing([PLACES[0]] * 100, range(100)) == [0] and counts == [24] * 24
