"""Answers from maps that are constant, unseen, or made of one pixel."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.query.maps import box_filter, fill_unseen, localize
from egosplat.query.text import Texts
from egosplat.query.views import View, answer_from_codes, pixel_position
from tests.support.langsplat import LANGSPLAT

CAMERA = Camera(8, 6, 7.0, 7.0, 4.0, 3.0)
IDENTITY = Decoder((4,), np.zeros(0, np.float32))
TEXTS = Texts(("cup",), torch.eye(4)[:1], torch.eye(4)[2:])
UNSEEN = {"uncovered": {"coverage": torch.zeros(2, 6, 8)}, "invalid": {"valid": np.zeros((6, 8), bool)}}
UNSEEN["NaN"] = {"coverage": torch.full((2, 6, 8), float("nan"))}


def view(**changes: object) -> View:
    """All pixels show the query, at 2 levels, 3 m away."""
    codes, valid = torch.zeros(2, 6, 8, 4), np.ones((6, 8), bool)
    codes[..., 0] = 1.0
    rendered = codes, torch.ones(2, 6, 8), torch.full((6, 8), 3.0)
    return replace(View(*rendered, CAMERA, np.eye(4), valid, "ab"), **changes)


@pytest.mark.numerics("constant map", within=1e-6, outside="location in the middle; empty mask")
def test_a_constant_map(measured):
    (answer,) = answer_from_codes(view(), IDENTITY, TEXTS, LANGSPLAT)
    measured(abs(answer.score - 1 / (1 + np.exp(-10.0))))
    assert answer.pixel in ((3, 2), (4, 2), (3, 3), (4, 3)) and not answer.mask.any()
    assert np.isfinite(answer.position).all()


@pytest.mark.numerics(
    "view without covered or valid pixels", outside="score 0; no location, mask or position"
)
@pytest.mark.parametrize("nothing", UNSEEN.values(), ids=UNSEEN)
def test_nothing_is_seen(nothing):
    (answer,) = answer_from_codes(view(**nothing), IDENTITY, TEXTS, LANGSPLAT)
    assert answer.score == 0 and answer.level is None and answer.pixel is None and answer.position is None
    assert not answer.relevancy.any() and not answer.mask.any() and answer.mask.shape == (6, 8)


@pytest.mark.numerics("picture of 1x1 px", within=1e-6)
def test_one_pixel(measured):
    rendered = torch.eye(4)[:1].reshape(1, 1, 1, 4), torch.ones(1, 1, 1), torch.ones(1, 1)
    one = View(*rendered, Camera(1, 1, 1, 1, 0.5, 0.5), np.eye(4), np.ones((1, 1), bool), "a")
    (answer,) = answer_from_codes(one, IDENTITY, TEXTS, LANGSPLAT)
    measured(abs(answer.score - 1 / (1 + np.exp(-10.0))))
    assert answer.pixel == (0, 0) and answer.position.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.numerics("depth 0, negative, NaN, infinity", outside="no position")
@pytest.mark.parametrize("depth", [0.0, -1.0, float("nan"), float("inf")])
def test_no_depth(depth):
    assert pixel_position(CAMERA, np.eye(4), (2, 3), np.full((6, 8), depth, np.float32)) is None


@pytest.mark.numerics("depth of 1e-30 to 1e30 m", within=1e-14)
@pytest.mark.parametrize("exponent", [-30, -3, 0, 3, 30])
def test_any_depth(measured, exponent):
    depth = np.full((6, 8), 10.0**exponent, np.float32)
    found = pixel_position(CAMERA, np.eye(4), (2, 3), depth)
    expected = np.array([(2.5 - 4.0) / 7.0, (3.5 - 3.0) / 7.0, 1.0]) * float(depth[0, 0])
    measured(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.mark.numerics(
    "box filter: relevancy of 1e-30 to 1, side from 1 px to more than the image",
    within=1e-6,
    outside="image mirrored several times",
)
@pytest.mark.parametrize("size", [1, 2, 7, 30, 64])
@pytest.mark.parametrize("scale", [1e-30, 1.0])
def test_smoothing(measured, size, scale):
    values = np.random.default_rng(0).uniform(size=(33, 47)).astype(np.float32) * np.float32(scale)
    reach = size // 2
    padded = np.pad(values.astype(np.float64), ((reach, reach), (reach, reach)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size))[:33, :47]
    measured(np.abs(box_filter(values, size) - windows.mean(axis=(2, 3))).max() / scale)


@pytest.mark.numerics("map with one visible pixel; with none", outside="that pixel; None")
def test_one_seen_pixel():
    values = np.full((1, 4, 5), 0.3, np.float32)
    seen = np.zeros((1, 4, 5), bool)
    assert localize(values, seen) is None
    assert not fill_unseen(values[0], seen[0]).any()
    seen[0, 2, 3] = True
    assert localize(values, seen)[2] == (3, 2)
