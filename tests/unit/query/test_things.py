"""Things in 3D: connected Gaussians that fit a query, told apart."""

import numpy as np
import pytest

from egosplat.query.things import LEAST_GAUSSIANS, Surface, find_things

SPACING = 0.1


def patch(x: float, side: int = 6) -> np.ndarray:
    """(side², 3) centers on a square whose left border is at ``x`` [m]."""
    along = SPACING * np.arange(side)
    return np.stack(np.meshgrid(along + x, along, [0.0]), axis=-1).reshape(-1, 3)


def surface(*patches: np.ndarray, levels: int = 1, shown: np.ndarray | None = None) -> Surface:
    """Patches that one view shows, each Gaussian in a thousandth of it unless ``shown`` (V, N) says otherwise."""
    means = np.concatenate(patches)
    shares = np.full((1, len(means)), 1e-3, np.float32) if shown is None else shown.astype(np.float32)
    return Surface.of(means, np.full(len(means), 0.04), shares, np.ones((len(means), levels), np.float32))


def relevancy(home: Surface, *values: float, levels: int = 1) -> np.ndarray:
    """(levels, N) one value a patch."""
    each = np.repeat(np.float32(values), len(home.means) // len(values))
    return np.tile(each, (levels, 1))


def test_two_of_a_kind_are_distinguished():
    """Two patches that fit, a meter apart, are two things with their own centers and boxes."""
    home = surface(patch(0.0), patch(1.5), patch(3.0))
    first, second = find_things(home, relevancy(home, 0.9, 0.1, 0.85), 0.7, 0.0, 3)
    assert first.score == pytest.approx(0.9) and second.score == pytest.approx(0.85)
    np.testing.assert_allclose(first.center, [0.25, 0.25, 0.0], atol=1e-6)
    np.testing.assert_allclose(second.center, [3.25, 0.25, 0.0], atol=1e-6)
    np.testing.assert_allclose(first.high - first.low, [0.5, 0.5, 0.0], atol=1e-6)


def test_the_number_of_things_is_limited():
    home = surface(patch(0.0), patch(1.5), patch(3.0))
    assert len(find_things(home, relevancy(home, 0.9, 0.1, 0.85), 0.7, 0.0, 1)) == 1


def test_touching_patches_are_one_thing():
    """Neighbors whose Gaussians reach each other belong together."""
    home = surface(patch(0.0), patch(6 * SPACING), patch(3.0))
    (thing,) = find_things(home, relevancy(home, 0.9, 0.9, 0.1), 0.7, 0.0, 3)
    assert len(thing.members) == 72


def test_a_speck_is_no_thing():
    """A few Gaussians that fit by chance are fewer than one neighborhood."""
    home = surface(patch(0.0), patch(2.0))
    values = relevancy(home, 0.6, 0.1)
    values[0, 36:38] = 1.0
    found = find_things(home, values, 0.4, 0.0, 3)
    assert [len(thing.members) for thing in found] == [36] and LEAST_GAUSSIANS > 2


def test_one_thing_at_two_levels_is_named_once():
    """The level at which it fits best names it."""
    home = surface(patch(0.0), patch(2.0), levels=2)
    values = relevancy(home, 0.8, 0.1, levels=2)
    values[1] *= 0.5
    (thing,) = find_things(home, values, 0.7, 0.0, 3)
    assert thing.level == 0 and thing.score == pytest.approx(0.8)


def test_what_no_view_shows_is_not_found():
    """A Gaussian without a visible share belongs to no thing, even where it fits best."""
    shown = np.r_[np.zeros(36), np.full(72, 1e-3)][None]
    home = surface(patch(0.0), patch(1.5), patch(3.0), shown=shown)
    (thing,) = find_things(home, relevancy(home, 1.0, 0.8, 0.1), 0.7, 0.0, 3)
    assert thing.members.min() == 36 and thing.score == pytest.approx(0.8)
    unseen = surface(patch(0.0), shown=np.zeros((1, 36)))
    assert find_things(unseen, relevancy(unseen, 0.9), 0.7, 0.0, 3) == []


def test_the_view_that_shows_most_is_named():
    shown = np.full((3, 72), 1e-4)
    shown[2, :36] = 2e-4
    home = surface(patch(0.0), patch(2.0), shown=shown)
    (thing,) = find_things(home, relevancy(home, 0.9, 0.1), 0.7, 0.0, 3)
    assert thing.view == 2


def test_small_things_score_less_as_under_a_box_filter():
    """A thing as large as the box filter's square keeps half of its relevancy, a large one nearly all."""
    side = np.sqrt(36e-3)
    home = surface(patch(0.0), patch(2.0))
    values = relevancy(home, 0.8, 0.1)
    (half,) = find_things(home, values, 0.7, side, 3)
    (full,) = find_things(home, values, 0.7, side / 100, 3)
    assert half.score == pytest.approx(0.4) and full.score == pytest.approx(0.8, rel=1e-3)


def test_single_gaussians_far_away_do_not_stretch_the_box():
    """A box ends at quantiles of what is visible."""
    means = np.concatenate([patch(0.0, 10), [[9.0, 9.0, 9.0]]])
    shares, share = np.full((1, 101), 1e-3, np.float32), np.ones((101, 1), np.float32)
    home = Surface.of(means, np.r_[np.full(100, 0.04), 20.0], shares, share)
    values = np.ones((1, 101), np.float32)
    values[0, 0] = 0.0
    (thing,) = find_things(home, values, 0.2, 0.0, 3)
    assert 100 in thing.members and thing.high.max() < 1.0


def test_an_empty_scene_has_no_things():
    shares, share = np.zeros((1, 0), np.float32), np.zeros((0, 2), np.float32)
    nothing = Surface.of(np.zeros((0, 3)), np.zeros(0), shares, share)
    assert find_things(nothing, np.zeros((2, 0), np.float32), 0.7, 0.0, 3) == []
