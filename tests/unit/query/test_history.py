"""Where a thing was, by what was carried."""

import numpy as np
import pytest
import torch

from egosplat.query.histories import Histories
from egosplat.query.history import Carried, clock, place_at
from egosplat.query.text import Texts

TABLE, DESK, SHELF = np.eye(3)
# Axes of features: a cup, a box, a hand, and any object.
CUP, BOX, HAND, OBJECT = torch.eye(4)


def carried(from_s, until_s, start, end):
    return Carried(0.9, from_s, until_s, start, end, 0, (0, 0, 1, 1))


HISTORY = (carried(4.2, 7.0, TABLE, DESK), carried(16.0, 18.5, DESK, SHELF))


@pytest.mark.parametrize(
    ("second", "position", "told"),
    [
        (0, TABLE, "until 0:04"),
        (4.2, None, "carried since 0:04, until 0:07"),
        (5, None, "carried since 0:04, until 0:07"),
        (10, DESK, "since 0:07, until 0:16"),
        (17, None, "carried since 0:16, until 0:18"),
        (18.6, SHELF, "since 0:18"),
        (1e6, SHELF, "since 0:18"),
        (-5, TABLE, "until 0:04"),
    ],
)
def test_a_thing_was_where_it_was_put_last(second, position, told):
    place = place_at(HISTORY, second)
    assert place.told == told
    assert (place.position is None) == (position is None)
    if position is not None:
        np.testing.assert_array_equal(place.position, position)


def test_what_was_not_carried_has_no_place_in_time():
    assert place_at((), 3.0) is None


def test_clock():
    assert [clock(second) for second in (0, 9.99, 65, 3600)] == ["0:00", "0:09", "1:05", "60:00"]


class Carries:
    """carries.zarr with these features, in turn at 0, 10, 20 ... s for five seconds each, or at once."""

    def __init__(self, features, step=10):
        count = len(features)
        first = step * np.arange(count)
        self.arrays = {
            "first_frame": first,
            "last_frame": first + 5,
            "start": np.zeros((count, 3)),
            "end": np.ones((count, 3)),
            "best_frame": first,
            "box": np.zeros((count, 4), np.int32),
            "feature": np.array(features, np.float32).reshape(count, 4),
        }

    def read(self, name):
        return self.arrays[name]


def history(features, step=10):
    """Seconds at which what "cup" means was taken up."""
    made = Histories(Carries(features, step), np.arange(100.0))
    words = Texts(("cup", "box", "hand"), torch.stack([CUP, BOX, HAND]), OBJECT[None])
    query = Texts(("cup",), CUP[None], OBJECT[None])
    return [one.from_s for one in made.of(query, words, 10.0)]


def mixed(*parts):
    total = sum(share * axis for share, axis in parts)
    return (total / total.norm()).tolist()


def test_only_what_looks_most_like_the_query_is_its_history():
    cup, box = CUP.tolist(), mixed((0.4, CUP), (0.6, BOX))
    assert history([cup, box, mixed((0.6, CUP), (0.4, HAND))]) == [0.0, 20.0]
    assert history([mixed((0.4, CUP), (0.6, OBJECT))]) == [], "like any object"


def test_of_carries_at_one_time_the_best_stays():
    assert history([mixed((0.8, CUP), (0.2, BOX)), CUP.tolist()], step=1) == [1.0]


def test_no_carry_and_no_view_have_no_history():
    assert history([]) == []
    assert history([[0.0] * 4]) == []
