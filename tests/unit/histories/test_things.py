"""Spans and links of rests, and which rests and carries are of one thing."""

from types import SimpleNamespace

import numpy as np
import pytest

from egosplat.histories import rests as finding
from egosplat.histories.places import End
from egosplat.histories.rests import ends_of, link
from egosplat.histories.things import features_of, group, match

SECONDS = np.arange(100) / 10
X, Y, _ = np.eye(3)


@pytest.mark.parametrize(
    ("beyond", "shares", "shown"),
    [
        ([1, 2, 3, 4], [0.5, 0.5, -0.5, -0.5], [True, True, False, False]),
        # One frame in which a hand hides it does not end a rest.
        ([1, 2, 3, 4], [0.5, 0.0, 0.5, 0.5], [True] * 4),
        # It comes before the track ends, but no more than two seconds.
        ([-3, -1, 1], [0.9, 0.9, 0.9], [False, True, True]),
        # What is only seen while it is carried does not rest.
        ([-1, 1], [0.9, -0.9], [False, False]),
        ([1, 2], [0.05, 0.05], [False, False]),
        ([], [], []),
    ],
)
def test_a_thing_rests_as_long_as_it_explains_the_pictures(beyond, shares, shown):
    assert finding._span(np.array(beyond, float), np.array(shares, float)).tolist() == shown


def test_views_in_which_little_changes_tell_little():
    told = np.array([[50.0, 100.0, 1000], [0.5, 0.5, 2], [0.0, 0.0, 0]])
    np.testing.assert_allclose(finding._shares(told)[:2], [0.5, 0.5])
    told[:, 2] = [1000, 1000, 1000]
    np.testing.assert_allclose(finding._shares(told), [0.5, 0.5 / 50, 0.0])
    assert finding._shares(np.zeros((0, 3))).shape == (0,)


def rest(x, first, last, evidence=1.0):
    return SimpleNamespace(center=x * X, radius=0.2, frames=(first, last), evidence=evidence)


def end(carry, after, x, second):
    return End(carry, after, x * X, 0.225, 0.3, second, 0)


def test_a_carry_leads_from_the_rest_before_to_the_rest_after():
    ends = [end(0, False, 0.0, 3.0), end(0, True, 1.0, 5.0)]
    for some, rests, linked in (
        (ends, [rest(0.0, 0, 30), rest(1.0, 50, 99)], [[0], [1]]),
        # Another place and another time are no link.
        (ends, [rest(0.5, 0, 30), rest(1.0, 80, 99)], [[-1], [-1]]),
        # Of two rests at an end the better one is linked.
        (ends[1:], [rest(1.0, 50, 99, 1.0), rest(1.05, 52, 99, 3.0)], [[-1], [1]]),
        ([], [rest(0.0, 0, 30)], [[], []]),
    ):
        assert link(some, rests, SECONDS, len(linked[0])).tolist() == linked


def test_two_equal_things_that_change_places_stay_two():
    ends = [end(0, False, 0, 3), end(0, True, 1, 6), end(1, False, 1, 3), end(1, True, 0, 6)]
    rests = [rest(0, 0, 30), rest(1, 0, 30), rest(0, 60, 99), rest(1, 60, 99)]
    found = link(ends, rests, SECONDS, 2)
    things, of_carries = group(4, found)
    assert things.tolist() == [0, 1, 1, 0] and of_carries.tolist() == [0, 1]


def test_a_carry_without_a_rest_is_of_no_thing():
    things, of_carries = group(1, np.array([[-1, 0], [-1, -1]], np.int32))
    assert things.tolist() == [0] and of_carries.tolist() == [-1, 0]
    things, of_carries = group(0, np.full((2, 3), -1, np.int32))
    assert things.tolist() == [] and of_carries.tolist() == [-1, -1, -1]
    assert group(0, np.zeros((2, 0), np.int32))[1].tolist() == []


@pytest.mark.parametrize(
    ("second", "one"),
    [
        (rest(1.0, 50, 99), True),
        (rest(0.3, 10, 40), True),
        (rest(0.5, 10, 40), False),
        (rest(0.5, 28, 90), True),
    ],
    ids=["afterwards", "part of it", "beside it", "at one end"],
)
def test_what_looks_alike_is_one_thing_unless_it_rests_at_two_places_at_once(second, one):
    """The second thing has a carry, the third looks otherwise."""
    rests = [rest(0.0, 0, 30), second, rest(0.0, 50, 99)]
    features = np.float32([[1, 0], [0.9, 0.19**0.5], [0, 1]])
    things, of_carries = match(np.arange(3), np.array([1, -1]), rests, features)
    assert things.tolist() == ([0, 0, 1] if one else [0, 1, 2])
    assert of_carries.tolist() == [0 if one else 1, -1]


def test_parts_of_a_thing_do_not_join_what_rests_elsewhere_at_once():
    """The second looks like both others, which are two."""
    rests = [rest(0.0, 0, 30), rest(0.3, 10, 40), rest(0.6, 0, 30)]
    features = np.float32([[1, 0], [0.99, 0.0199**0.5], [0.99, 0.0199**0.5]])
    things, _ = match(np.arange(3), np.zeros(0, int), rests, features)
    assert things[0] != things[2] and len(set(things.tolist())) == 2


def test_a_thing_looks_like_its_rests_and_carries():
    every = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    found = features_of(np.array([0, 1, 0, 1]), every)
    np.testing.assert_allclose(found, [[0.5**0.5, 0.5**0.5], [0, 0]], rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_places_are_relative_to_the_sizes_of_things(scale):
    carries = [
        SimpleNamespace(track=track, first=0, last=last, start=np.full(3, np.nan), end=end, size=scale * size)
        for track, last, end, size in ((0, 5, scale * X, 1.0), (1, 9, scale * Y, 3.0))
    ]
    ends = ends_of(carries, SECONDS)
    np.testing.assert_allclose([one.radius for one in ends], [0.9 * scale, 2.1 * scale])
    told = [(one.carry, one.after, one.second, one.track) for one in ends]
    assert told == [(0, True, 0.5, 0), (1, True, 0.9, 1)]
