"""Carries among sightings: places, times, rests between, slips, arms, parts of one thing."""

import numpy as np
import pytest

from egosplat.histories.moves import find_carries
from tests.support.sightings import BACK, HERE, RATE, SIZE, THERE, found, sightings, way

WAY = way((HERE, 10), (THERE, 10))


def test_a_carry_has_two_places_and_two_times():
    [one] = found((10, WAY))
    np.testing.assert_allclose([one.start, one.end], [HERE, THERE], atol=0.01)
    # It moves in frames 20 to 29; the window reaches two frames beyond.
    assert abs(one.first - 20) <= 2 and abs(one.last - 29) <= 2
    assert one.size == pytest.approx(SIZE) and one.track == 0


def test_a_rest_of_a_second_separates_two_carries():
    first, second = found((0, way((HERE, 8), (THERE, 9), (BACK, 8))))
    np.testing.assert_allclose([first.end, second.start], [THERE, THERE], atol=0.05)
    np.testing.assert_allclose(second.end, BACK, atol=0.01)
    assert first.last < second.first
    [whole] = found((0, way((HERE, 8), (THERE, 2), (BACK, 8))))
    np.testing.assert_allclose([whole.start, whole.end], [HERE, BACK], atol=0.05)


@pytest.mark.parametrize(
    ("tracks", "edge"),
    [
        # It is shifted by less than two of its sizes, or too few frames show it.
        ([(0, way((HERE, 10), (HERE + [0.3, 0, 0], 10)))], 0.0),
        ([(0, WAY[14:17])], 0.0),
        # A track that slips to another thing is cut, and so one without a mask for a second.
        ([(0, np.repeat([HERE, THERE], 10, axis=0))], 0.0),
        ([(0, WAY[:12]), (30, WAY[18:])], 0.0),
        # Arms at the edge of the picture are no things.
        ([(0, WAY)], 0.03),
    ],
)
def test_what_stays_is_not_carried(tracks, edge):
    assert found(*tracks, edge=edge) == []


def test_a_thing_that_is_lost_on_its_way_ends_nowhere():
    """The last step is longer than the thing: nobody sees where it goes."""
    centers = way((HERE, 10), (THERE, 1))[:-2]
    lost = np.concatenate([centers, centers[-1:] + [0.25, 0, 0]])
    [one] = found((0, lost))
    assert np.isnan(one.end).all()
    np.testing.assert_allclose(one.start, HERE, atol=0.01)
    [seen] = found((0, np.concatenate([lost, np.tile(lost[-1], (10, 1))])))
    np.testing.assert_allclose(seen.end, lost[-1], atol=0.01)


def test_what_the_wearer_holds_does_not_slip():
    """The depth behind it jumps, and it stays before the camera."""
    centers = np.repeat(np.linspace(HERE, THERE, 3), (10, 1, 10), axis=0)
    seen = sightings((0, 2 * centers))
    seconds = np.arange(len(centers)) / RATE
    assert find_carries(seen, {}, seconds) == [], "each step is a slip"
    assert find_carries(seen[:0], {}, seconds[:0]) == []
    seen.local[:] = HERE
    [one] = find_carries(seen, {}, seconds)
    np.testing.assert_allclose([one.start, one.end], [2 * HERE, 2 * THERE], atol=0.01)


def test_parts_of_one_thing_are_one_carry():
    tracks = (0, WAY), (4, WAY[4:24])
    nested, apart = ({(frame, 1, 0): share for frame in range(40)} for share in (0.9, 0.2))
    [one] = found(*tracks, inside=nested)
    assert one.track == 0 and one.others == (1,)
    assert len(found(*tracks, inside=apart)) == 2


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_lengths_are_relative(scale):
    [one] = found((0, scale * WAY), size=scale * SIZE)
    np.testing.assert_allclose(one.end, scale * THERE, rtol=0.02)
