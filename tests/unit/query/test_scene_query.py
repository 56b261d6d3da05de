"""The whole scene is asked: things in 3D, the view that shows each best, and the thing in that view."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FEATURES, LANGUAGE, POSES, SPLATS
from egosplat.geometry import Camera
from egosplat.query.options import LANGSPLAT
from egosplat.query.scene import read_scene
from egosplat.query.scene_query import SceneIndex, ask_scene, index_scene
from egosplat.query.text import Texts
from egosplat.query.thing_view import view_thing

CAMERA = Camera(48, 48, 44.0, 44.0, 24.0, 24.0)


@pytest.fixture
def index(word_scene) -> SceneIndex:
    """A wall whose left half means a couch and whose right half means a cup."""
    folder = word_scene()
    artifacts = [open_artifact(folder / f"{one.name}.zarr", one) for one in (SPLATS, LANGUAGE, FEATURES)]
    poses = open_artifact(folder / "poses.zarr", POSES).read("camera_to_world")
    return index_scene(read_scene(*artifacts, "cpu"), poses, CAMERA, None)


@pytest.fixture
def texts(couch_and_cup) -> Texts:
    """Both words, against the direction between them."""
    between = torch.nn.functional.normalize(couch_and_cup.sum(0, keepdim=True))
    return Texts(("couch", "cup"), couch_and_cup, between)


def test_views_are_those_of_frames_with_a_pose(index):
    """The last frame of the scene has none."""
    np.testing.assert_array_equal(index.frame, [0, 1, 2])
    np.testing.assert_allclose(index.surface.shares.sum(axis=1), 1.0, atol=1e-3)


def test_each_word_finds_its_half(index, texts):
    couch, cup = ask_scene(index, texts, LANGSPLAT, 3)
    assert (couch.phrase, cup.phrase) == ("couch", "cup")
    assert couch.things[0].center[0] < -0.3 and cup.things[0].center[0] > 0.3
    assert couch.things[0].score > 0.8 and couch.things[0].level == 1
    assert index.best_frame(couch.things[0]) == 0


def test_answers_are_the_same_in_parts(index, texts, monkeypatch):
    """More queries than memory holds are asked in turn."""
    whole = [answer.things[0].score for answer in ask_scene(index, texts, LANGSPLAT, 1)]
    monkeypatch.setattr("egosplat.query.scene_query._NUMBERS_AT_ONCE", 1)
    parts = [answer.things[0].score for answer in ask_scene(index, texts, LANGSPLAT, 1)]
    np.testing.assert_allclose(parts, whole, rtol=1e-5)


def test_a_scene_without_codes_has_no_answer(index, texts):
    bare = replace(index, scene=replace(index.scene, share=torch.zeros_like(index.scene.share)))
    surface = index.surface
    empty = type(surface).of(
        surface.means, np.full(len(surface.means), 0.1), surface.shares, 0 * surface.weight
    )
    (answer, _) = ask_scene(replace(bare, surface=empty), texts, LANGSPLAT, 3)
    assert answer.things == ()


def see(index, thing, texts, valid):
    """What the camera shows of a couch."""
    couch = texts.of(["couch"])
    return view_thing(index.scene, thing.members, thing.level, couch, CAMERA, np.eye(4), valid, LANGSPLAT)


def test_a_thing_is_shown_where_it_is(index, texts):
    """Mask, place and relevancy of the couch lie in the left half of the view."""
    (couch,) = ask_scene(index, texts.of(["couch"]), LANGSPLAT, 1)
    seen = see(index, couch.things[0], texts, None)
    assert seen.mask[:, :18].mean() > 0.8 and seen.mask[:, 30:].mean() < 0.05
    column, row = seen.pixel
    assert column < 20 and seen.mask[row, column]
    assert seen.relevancy[:, :16].mean() > 0.8 and seen.relevancy[:, 32:].mean() < 0.2


def test_masked_pixels_are_in_no_answer(index, texts):
    valid = np.zeros((48, 48), bool)
    (couch,) = ask_scene(index, texts.of(["couch"]), LANGSPLAT, 1)
    seen = see(index, couch.things[0], texts, valid)
    assert not seen.mask.any() and seen.pixel is None and not seen.relevancy.any()
