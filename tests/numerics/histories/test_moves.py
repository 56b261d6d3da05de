"""Carries at their extremes: no rest, nothing but rest, rests of one frame, equal things, and times that are out of order."""

import numpy as np
import pytest

from tests.support.sightings import BACK, HERE, RATE, THERE, found, way


@pytest.mark.numerics(
    "object that moves in every frame of 1 to 40 s", outside="one carry; start and end unknown"
)
@pytest.mark.parametrize("count", [5, 50, 200])
def test_never_at_rest(count):
    turns = 0.15 * np.arange(count)
    centers = HERE + 2 * np.stack([np.cos(turns), np.sin(turns), np.zeros(count)], axis=1)
    [one] = found((0, centers))
    assert np.isnan(one.start).all() and (one.first, one.last) == (0, count - 1)
    assert np.isnan(one.end).all(), "five sizes a second is too fast to have been put down"


@pytest.mark.numerics("object that lies still, exactly or with depths that vary by 1 %", outside="no carry")
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_always_at_rest(noise):
    rng = np.random.default_rng(0)
    assert found((0, HERE * (1 + rng.uniform(-noise, noise, (200, 1))))) == []


@pytest.mark.numerics(
    "object still in one frame before, between or after two movements",
    outside="between: one carry; before: start unknown; after: end where last seen",
)
def test_a_rest_of_one_frame():
    [one] = found((0, way((HERE, 10), (THERE, 1), (BACK, 10))))
    np.testing.assert_allclose([one.start, one.end], [HERE, BACK], atol=0.05)
    [one] = found((0, way((HERE, 1), (THERE, 10))))
    assert np.isnan(one.start).all()
    np.testing.assert_allclose(one.end, THERE, atol=0.05)
    centers = way((HERE, 10), (THERE, 1))
    [one] = found((0, centers))
    np.testing.assert_allclose(one.start, HERE, atol=0.05)
    assert one.last == len(centers) - 1
    np.testing.assert_array_equal(one.end, centers[-1])


@pytest.mark.numerics("object picked up 2 and 6 frames before the end", outside="6: carry to where last seen")
@pytest.mark.parametrize(("left", "carries"), [(2, 0), (6, 1)])
def test_the_last_frames(left, carries):
    centers = way((HERE, 10), (THERE, 10))[: 10 + left]
    seen = found((200 - len(centers), centers))
    assert len(seen) == carries
    for one in seen:
        assert one.last == 199
        np.testing.assert_array_equal(one.end, centers[-1])


@pytest.mark.numerics(
    "times that repeat, decrease, jump by a day, or are shuffled",
    outside="carries in order of frames, finite ends",
)
@pytest.mark.parametrize(
    "seconds",
    [
        np.repeat(np.arange(50) / RATE, 4),
        np.zeros(200),
        np.arange(200)[::-1] / RATE,
        np.where(np.arange(200) < 15, 0, 86400.0) + np.arange(200) / RATE,
        np.random.default_rng(0).permutation(200) / RATE,
    ],
    ids=["repeat", "all one", "backwards", "a jump", "shuffled"],
)
def test_times_out_of_order(seconds):
    for one in found((0, way((HERE, 10), (THERE, 10), (BACK, 10))), seconds=seconds):
        assert 0 <= one.first <= one.last < 50 and np.isfinite(one.end).all() and one.size > 0
