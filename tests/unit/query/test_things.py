"""Things in 3D: connected Gaussians that fit a query, told apart, and the views that show them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FEATURES, LANGUAGE, POSES, SPLATS
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.query import text
from egosplat.query.scene import Viewpoint, read_scene
from egosplat.query.text import Texts
from egosplat.query.things import (
    Surface,
    ask_scene,
    find_neighbors,
    find_things,
    read_surface,
    visible_shares,
)
from egosplat.query.views import show_thing
from egosplat.rasterize.view import composite
from tests.support.langsplat import LANGSPLAT
from tests.support.splats import blobs

SPACING = 0.1


def patch(x: float, side: int = 6) -> np.ndarray:
    """(side², 3) centers on a square whose left border is at ``x`` [m]."""
    along = SPACING * np.arange(side)
    return np.stack(np.meshgrid(along + x, along, [0.0]), axis=-1).reshape(-1, 3)


def of_points(means, radii, shown=None, levels: int = 1, instance=None) -> Surface:
    """A surface whose views are frames 0, 10, 20 ..., by default one that shows each Gaussian in a thousandth of it."""
    shares = np.float32(np.full((1, len(means)), 1e-3) if shown is None else shown)
    weight = np.repeat(shares.mean(axis=0)[:, None], levels, axis=1)
    frames = 10 * np.arange(len(shares))
    return Surface(means, find_neighbors(means, radii), shares, weight, frames, "abc"[:levels], instance)


def surface(*lefts: float, levels: int = 1, shown: np.ndarray | None = None) -> Surface:
    means = np.concatenate([patch(left) for left in lefts])
    return of_points(means, np.full(len(means), 0.04), shown, levels)


def relevancy(home: Surface, *values: float, levels: int = 1) -> np.ndarray:
    """(levels, N) one value a patch."""
    return np.tile(np.repeat(np.float32(values), len(home.means) // len(values)), (levels, 1))


def test_two_of_a_kind_are_distinguished():
    home = surface(0.0, 1.5, 3.0)
    values = relevancy(home, 0.9, 0.1, 0.85)
    first, second = find_things(home, values, 0.7, 0.0, 3)
    assert len(find_things(home, values, 0.7, 0.0, 1)) == 1
    assert first.score == pytest.approx(0.9) and second.score == pytest.approx(0.85)
    np.testing.assert_allclose([first.center, second.center], [[0.25, 0.25, 0], [3.25, 0.25, 0]], atol=1e-6)
    np.testing.assert_allclose(first.size, [0.5, 0.5, 0.0], atol=1e-6)
    home = surface(0.0, 6 * SPACING, 3.0)
    (thing,) = find_things(home, relevancy(home, 0.9, 0.9, 0.1), 0.7, 0.0, 3)
    assert len(thing.members) == 72


def test_a_speck_is_no_thing_and_one_thing_at_two_levels_is_named_once():
    home = surface(0.0, 2.0, levels=2)
    values = relevancy(home, 0.8, 0.1, levels=2) * np.float32([[1.0], [0.5]])
    # Two Gaussians that fit by chance are fewer than one neighborhood.
    values[0, 36:38] = 1.0
    (thing,) = find_things(home, values, 0.4, 0.0, 3)
    assert thing.level == "a" and thing.score == pytest.approx(0.8) and len(thing.members) == 36


def test_one_thing_is_told_once():
    home = surface(0.0, 1.5, 3.0)
    values = relevancy(home, 0.9, 0.1, 0.85)
    for owners, count in (((4, 4, 4), 1), ((4, 5, 5), 2), ((-1, -1, -1), 2)):
        owned = replace(home, instance=np.repeat(np.int32(owners), 36))
        assert len(find_things(owned, values, 0.7, 0.0, 3)) == count
    # A frame of four sides around a patch.
    ring = np.concatenate([patch(0.0, 20), patch(0.7, 6) + [0, 0.7, 0]])
    inner = (np.abs(ring[:400] - [0.95, 0.95, 0])[:, :2] < 0.6).all(axis=1)
    values = np.float32(np.r_[np.where(inner, 0.1, 0.9), np.full(36, 0.85)])[None]
    assert len(find_things(of_points(ring, np.full(len(ring), 0.03)), values, 0.7, 0.0, 3)) == 1


def test_what_no_view_shows_is_not_found():
    """A Gaussian without a visible share belongs to no thing; the view that shows most of one names its frame."""
    shown = np.r_[np.zeros(36), np.full(72, 1e-3)] * [[0.5], [0.5], [2.0]]
    home = surface(0.0, 1.5, 3.0, shown=shown)
    (thing,) = find_things(home, relevancy(home, 1.0, 0.8, 0.1), 0.7, 0.0, 3)
    assert thing.members.min() == 36 and thing.score == pytest.approx(0.8) and thing.frame == 20
    unseen = surface(0.0, shown=np.zeros((1, 36)))
    assert find_things(unseen, relevancy(unseen, 0.9), 0.7, 0.0, 3) == []
    nothing = of_points(np.zeros((0, 3)), np.zeros(0), levels=2)
    assert find_things(nothing, np.zeros((2, 0), np.float32), 0.7, 0.0, 3) == []


def test_small_things_score_less_as_under_a_box_filter():
    """A thing as large as the box filter's square keeps half of its relevancy, a large one nearly all."""
    home, side = surface(0.0, 2.0), np.sqrt(36e-3)
    for box, score in ((side, 0.4), (side / 100, 0.8)):
        (thing,) = find_things(home, relevancy(home, 0.8, 0.1), 0.7, box, 3)
        assert thing.score == pytest.approx(score, rel=1e-3)


def test_single_gaussians_far_away_do_not_stretch_the_box():
    means = np.concatenate([patch(0.0, 10), [[9.0, 9.0, 9.0]]])
    home = of_points(means, np.r_[np.full(100, 0.04), 20.0])
    (thing,) = find_things(home, np.float32(np.arange(101) > 0)[None], 0.2, 0.0, 3)
    assert 100 in thing.members and thing.size.max() < 1.0


WALL = Camera(48, 48, 44.0, 44.0, 24.0, 24.0)


@pytest.fixture
def scene(word_scene):
    """A wall whose left half means a couch and whose right half means a cup, with its surface."""
    folder = word_scene()
    artifacts = [open_artifact(folder / f"{one.name}.zarr", one) for one in (SPLATS, LANGUAGE, FEATURES)]
    poses = open_artifact(folder / "poses.zarr", POSES).read("camera_to_world")
    read = read_scene(*artifacts, "cpu")
    return read, read_surface(read, poses, WALL, None)


@pytest.fixture
def texts(couch_and_cup) -> Texts:
    """Both words, against the direction between them."""
    return Texts(("couch", "cup"), couch_and_cup, torch.nn.functional.normalize(couch_and_cup.sum(0)[None]))


def test_each_word_finds_its_half(scene, texts, monkeypatch):
    surface = scene[1]
    np.testing.assert_array_equal(surface.frame, [0, 1, 2])
    np.testing.assert_allclose(surface.shares.sum(axis=1), 1.0, atol=1e-3)
    whole = [found[0] for found in ask_scene(*scene, texts, LANGSPLAT, 3)]
    couch, cup = whole
    assert couch.center[0] < -0.3 and cup.center[0] > 0.3
    assert couch.score > 0.8 and couch.level == "whole" and couch.frame == 0
    monkeypatch.setattr(text, "AT_ONCE", 1)
    parts = [found[0].score for found in ask_scene(*scene, texts, LANGSPLAT, 1)]
    np.testing.assert_allclose(parts, [one.score for one in whole], rtol=1e-5)


def test_what_was_decoded_once_answers_as_if_anew(scene, texts):
    kept, other = scene[0], replace(texts, canonical=texts.queries[:1])
    for asked in (texts, texts, other, texts):
        assert torch.equal(kept.relevancy(asked, LANGSPLAT), replace(kept).relevancy(asked, LANGSPLAT))
    assert len(kept._kept) == 1


@pytest.mark.parametrize("valid", [True, False])
def test_a_thing_is_shown_where_it_is(scene, texts, valid):
    couch = texts.of(["couch"])
    [[thing]] = ask_scene(*scene, couch, LANGSPLAT, 1)
    at = Viewpoint("", np.eye(4), np.full((48, 48), valid))
    seen = show_thing(scene[0], thing, couch, WALL, at, LANGSPLAT)
    if not valid:
        assert not seen.mask.any() and seen.pixel is None and not seen.relevancy.any()
        return
    assert seen.mask[:, :18].mean() > 0.8 and seen.mask[:, 30:].mean() < 0.05
    column, row = seen.pixel
    assert column < 20 and seen.mask[row, column]
    assert seen.relevancy[:, :16].mean() > 0.8 and seen.relevancy[:, 32:].mean() < 0.2


CAMERA = Camera(20, 16, 18.0, 18.0, 10.0, 8.0)
SETTINGS = RenderSettings(near_plane=0.1, background="black", backend="cpu")


def test_shares_are_sums_of_compositing_weights():
    """Each Gaussian rendered alone in white, behind what hides it, gives the same sum."""
    # A translucent Gaussian in front of an opaque one, one aside, one behind the camera.
    cloud = blobs([[0, 0, 2], [0, 0, 3], [0.6, 0, 2], [0, 0, -2]], [0.5, 0.98, 0.98, 0.98], 0.2)
    (shares,) = visible_shares(cloud, CAMERA, [np.eye(4)], None, SETTINGS)
    weights, _ = composite(view_of(cloud, CAMERA, np.eye(4), SETTINGS), torch.eye(4))
    # The share of the picture that each pixel counts as.
    rows, columns = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (16, 20))
    window = np.outer(rows / rows.sum(), columns / columns.sum())
    expected = (weights.numpy() * window[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(shares.numpy(), expected, rtol=1e-4, atol=1e-7)
    assert shares[3] == 0.0 and 0 < shares.sum() <= 1.0
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    both = visible_shares(cloud, CAMERA, [np.eye(4), behind], None, SETTINGS)
    assert both.shape == (2, 4) and both[1, 3] > 0 and (both[1, :3] == 0).all()
    assert visible_shares(cloud, CAMERA, [], None, SETTINGS).shape == (0, 4)
    # A lens circle that leaves out the right half hides what is there.
    valid = np.ones((16, 20), bool)
    valid[:, 10:] = False
    (half,) = visible_shares(cloud, CAMERA, [np.eye(4)], valid, SETTINGS)
    assert half[2] < 0.1 * shares[2] and half[0] > 0.3 * shares[0]
