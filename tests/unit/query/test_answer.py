"""Answers from codes whose features are known."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.query import answer as module
from egosplat.query.answer import View, answer_from_codes
from egosplat.query.options import LANGSPLAT
from egosplat.query.text import Texts

SIZE = 48
CAMERA = Camera(SIZE, SIZE, 40.0, 40.0, SIZE / 2, SIZE / 2)
IDENTITY = Decoder((8,), np.zeros(0, np.float32))
OPTIONS = LANGSPLAT.change(box_filter=6 / SIZE, majority_filter=7 / SIZE)
DIRECTIONS = torch.eye(8)
TEXTS = Texts(("cup", "couch"), DIRECTIONS[:2], DIRECTIONS[4:])
"""Cup and couch are directions 0 and 1; 3 is the wall, which fits no phrase; 4 to 7 are canonical."""


@pytest.fixture
def view() -> View:
    """A wall with a couch at level 2, on which a cup is seen at level 0; level 1 shows the wall alone."""
    codes = DIRECTIONS[3].expand(3, SIZE, SIZE, 8).clone()
    codes[2, 8:32, 10:40] = DIRECTIONS[1]
    codes[0, 14:24, 20:30] = DIRECTIONS[0]
    depth = torch.full((SIZE, SIZE), 3.0)
    return View(codes, torch.ones(3, SIZE, SIZE), depth, CAMERA, np.eye(4), None)


def test_each_query_is_answered_at_its_level(view):
    cup, couch = answer_from_codes(view, IDENTITY, TEXTS, OPTIONS)
    assert (cup.phrase, cup.level, cup.mask_level) == ("cup", 0, 0)
    assert (couch.phrase, couch.level, couch.mask_level) == ("couch", 2, 2)
    assert 20 <= cup.pixel[0] < 30 and 14 <= cup.pixel[1] < 24
    assert 10 <= couch.pixel[0] < 40 and 8 <= couch.pixel[1] < 32
    assert cup.score == pytest.approx(1 / (1 + np.exp(-10.0)), abs=1e-5)


def test_the_mask_is_the_thing(view):
    _, couch = answer_from_codes(view, IDENTITY, TEXTS, OPTIONS)
    truth = np.zeros((SIZE, SIZE), bool)
    truth[8:32, 10:40] = True
    assert couch.mask.dtype == bool and (couch.mask & truth).sum() / (couch.mask | truth).sum() > 0.95
    assert couch.relevancy.dtype == np.float32
    np.testing.assert_allclose(couch.relevancy[truth], 1 / (1 + np.exp(-10.0)), rtol=1e-5)
    np.testing.assert_allclose(couch.relevancy[~truth], 0.5, rtol=1e-5)


def test_the_place_is_in_the_world(view):
    pose = np.eye(4)
    pose[:3, 3] = [10.0, 20.0, 30.0]
    cup, _ = answer_from_codes(replace(view, camera_to_world=pose), IDENTITY, TEXTS, OPTIONS)
    in_camera = cup.position - pose[:3, 3]
    assert in_camera[2] == pytest.approx(3.0)
    np.testing.assert_allclose(CAMERA.project(in_camera), np.array(cup.pixel) + 0.5)


def test_coarse_codes_answer_at_the_pictures_size(view):
    coarse = replace(
        view, codes=view.codes[:, ::2, ::2], coverage=view.coverage[:, ::2, ::2], depth=view.depth[::2, ::2]
    )
    for fine, found in zip(
        answer_from_codes(view, IDENTITY, TEXTS, OPTIONS),
        answer_from_codes(coarse, IDENTITY, TEXTS, OPTIONS),
        strict=True,
    ):
        assert found.mask.shape == found.relevancy.shape == (SIZE, SIZE) and found.level == fine.level
        assert (found.mask & fine.mask).sum() / (found.mask | fine.mask).sum() > 0.6
        assert np.abs(np.subtract(found.pixel, fine.pixel)).max() <= 2


def test_what_is_not_covered_is_no_answer_and_moves_no_threshold(view):
    """The cup is hidden at its level; the couch's mask stays as it was."""
    coverage = view.coverage.clone()
    coverage[0, 14:24, 20:30] = 0.005
    coverage[2, 40:] = 0.0
    whole = list(answer_from_codes(view, IDENTITY, TEXTS, OPTIONS))
    cup, couch = answer_from_codes(replace(view, coverage=coverage), IDENTITY, TEXTS, OPTIONS)
    assert cup.score == pytest.approx(0.5, abs=1e-5) and whole[0].score > 0.99
    np.testing.assert_array_equal(couch.mask, whole[1].mask)
    assert not couch.relevancy[40:].any() and couch.relevancy[:40].min() > 0.4


def test_pixels_that_are_not_valid_do_not_answer(view):
    valid = np.ones((SIZE, SIZE), bool)
    valid[:, 20:] = False
    cup, couch = answer_from_codes(replace(view, valid=valid), IDENTITY, TEXTS, OPTIONS)
    assert not (cup.mask | couch.mask)[:, 20:].any() and couch.mask[10:30, 12:18].all()
    assert cup.pixel[0] < 20 and not couch.relevancy[:, 20:].any()


def test_many_queries_are_answered_in_turn_and_order(view, monkeypatch):
    names = tuple("abcdefg")
    texts = Texts(names, DIRECTIONS[[0, 1, 0, 1, 0, 1, 0]], TEXTS.canonical)
    monkeypatch.setattr(module, "_MAPS_AT_ONCE", 3 * 3 * SIZE * SIZE)
    found = list(answer_from_codes(view, IDENTITY, texts, OPTIONS))
    assert [one.phrase for one in found] == list(names)
    assert [one.level for one in found] == [0, 2, 0, 2, 0, 2, 0]


def test_invalid_arguments_are_rejected(view):
    codes = view.codes.clone()
    codes[0, 0, 0, 0] = float("nan")
    broken = {
        "not finite": {"codes": codes},
        "coverage": {"coverage": view.coverage[:2]},
        "depth": {"depth": view.depth[1:]},
        "valid": {"valid": np.ones((SIZE, SIZE + 1), bool)},
    }
    for reason, changes in broken.items():
        with pytest.raises(ValueError, match=reason):
            next(answer_from_codes(replace(view, **changes), IDENTITY, TEXTS, OPTIONS))
