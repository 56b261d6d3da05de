"""Answers in one view: of codes that are rendered and decoded, and of Gaussians that are compared."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.gaussians.render import view_of as gaussians_in
from egosplat.geometry import Camera, invert, make_pose, transform
from egosplat.language.decoder import Decoder
from egosplat.query import text
from egosplat.query.scene import QueryScene, Viewpoint, rendering_camera
from egosplat.query.text import Texts
from egosplat.query.views import Asker, View, answer_from_codes, pixel_position
from egosplat.rasterize.view import composite
from tests.support.gaussian_scene import SETTINGS
from tests.support.langsplat import LANGSPLAT
from tests.support.splats import blobs

SIZE = 48
SQUARE = Camera(SIZE, SIZE, 40.0, 40.0, SIZE / 2, SIZE / 2)
WIDE = Decoder((8,), np.zeros(0, np.float32))
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
    coverage, depth = torch.ones(3, SIZE, SIZE), torch.full((SIZE, SIZE), 3.0)
    valid, levels = np.ones((SIZE, SIZE), bool), ["part", "middle", "whole"]
    return View(codes, coverage, depth, SQUARE, np.eye(4), valid, levels)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


def test_each_query_is_answered_at_its_level_and_its_mask_is_the_thing(view):
    cup, couch = answer_from_codes(view, WIDE, TEXTS, OPTIONS)
    assert (cup.phrase, cup.level, cup.mask_level) == ("cup", "part", "part")
    assert (couch.phrase, couch.level, couch.mask_level) == ("couch", "whole", "whole")
    assert 20 <= cup.pixel[0] < 30 and 14 <= cup.pixel[1] < 24 and couch.mask[couch.pixel[::-1]]
    assert cup.score == pytest.approx(1 / (1 + np.exp(-10.0)), abs=1e-5)
    truth = np.zeros((SIZE, SIZE), bool)
    truth[8:32, 10:40] = True
    assert couch.mask.dtype == bool and overlap(couch.mask, truth) > 0.95
    assert couch.relevancy.dtype == np.float32
    np.testing.assert_allclose(couch.relevancy[truth], 1 / (1 + np.exp(-10.0)), rtol=1e-5)
    np.testing.assert_allclose(couch.relevancy[~truth], 0.5, rtol=1e-5)


def test_coarse_codes_answer_at_the_pictures_size(view):
    half = {name: getattr(view, name)[:, ::2, ::2] for name in ("codes", "coverage")}
    coarse = replace(view, **half, depth=view.depth[::2, ::2])
    pairs = (answer_from_codes(one, WIDE, TEXTS, OPTIONS) for one in (view, coarse))
    for fine, found in zip(*pairs, strict=True):
        assert found.mask.shape == found.relevancy.shape == (SIZE, SIZE) and found.level == fine.level
        assert overlap(found.mask, fine.mask) > 0.6 and np.allclose(found.pixel, fine.pixel, rtol=0, atol=2)


def test_what_is_not_covered_is_no_answer_and_moves_no_threshold(view):
    coverage = view.coverage.clone()
    coverage[0, 14:24, 20:30] = 0.005
    coverage[2, 40:] = 0.0
    whole = list(answer_from_codes(view, WIDE, TEXTS, OPTIONS))
    cup, couch = answer_from_codes(replace(view, coverage=coverage), WIDE, TEXTS, OPTIONS)
    assert cup.score == pytest.approx(0.5, abs=1e-5) and whole[0].score > 0.99
    np.testing.assert_array_equal(couch.mask, whole[1].mask)
    assert not couch.relevancy[40:].any() and couch.relevancy[:40].min() > 0.4


CAMERA, EYE = Camera(64, 48, 60.0, 60.0, 32.0, 24.0), np.eye(4)
IDENTITY = Decoder((4,), np.zeros(0, np.float32))
READOUTS = ("gaussians", "pixels")
PAIR = Texts(("left", "right"), torch.eye(4)[:2], torch.eye(4)[2:3])


def ask(scene, options, texts=PAIR, pose=EYE):
    return Asker(scene, texts, options).ask(texts.phrases, CAMERA, Viewpoint("", pose, None))


@pytest.fixture
def scene() -> QueryScene:
    """Two opaque balls at 2 m, left and right, that mean directions 0 and 1 at the one level there is."""
    balls = blobs([[-0.5, 0.0, 2.0], [0.5, 0.1, 2.0]], [0.98, 0.98], 0.1)
    codes = torch.eye(4)[:2, None], torch.ones(2, 1)
    return QueryScene(balls, SETTINGS, CAMERA, 0, *codes, IDENTITY, ["whole"])


@pytest.mark.parametrize("resolution, size", [(0, (64, 48)), (1000, (64, 48)), (32, (32, 24)), (1, (1, 1))])
def test_the_longer_side_is_brought_down(resolution, size):
    camera = rendering_camera(CAMERA, resolution)
    assert (camera.width, camera.height) == size and camera.cx / camera.width == pytest.approx(0.5)


@pytest.mark.parametrize("resolution", [0, 32])
def test_things_are_found_at_their_position(scene, resolution):
    options = LANGSPLAT.change(box_filter=4 / 64, resolution=resolution)
    pairs = zip(*(ask(scene, options.change(readout=one)) for one in READOUTS), strict=True)
    for (gaussians, pixels), place in zip(pairs, scene.gaussians.means.numpy(), strict=True):
        assert pixels.score > 0.99 and np.abs(pixels.position - place).max() < 0.15
        assert pixels.position[2] == pytest.approx(2.0, abs=1e-3)
        assert pixels.mask.any() and not pixels.mask[:, 30:34].any()
        assert gaussians.score == pytest.approx(pixels.score, abs=1e-4)
        assert gaussians.level == pixels.level and gaussians.mask.shape == pixels.mask.shape == (48, 64)
        # All pixels of a ball are equal but for rounding: any of them is the place.
        assert np.abs(gaussians.position - pixels.position).max() < 0.2
        assert overlap(gaussians.mask, pixels.mask) > 0.8


def test_a_pixel_of_two_gaussians_is_no_third_thing(scene):
    """The mean of two codes decodes to what neither Gaussian shows; rendered relevancies know no such thing."""
    diagonal = torch.nn.functional.normalize(torch.tensor([[1.0, 1.0, 0.0, 0.0]]))
    texts = Texts(("between",), diagonal, torch.eye(4)[2:3])
    scene.gaussians.means[:, :2] = 0.0
    scene.gaussians.logit_opacities[:] = 0.0
    options = LANGSPLAT.change(box_filter=0.0)
    [blended] = ask(scene, options.change(readout="pixels"), texts)
    asker = Asker(scene, texts, options)
    [rendered] = asker.ask(["between"], CAMERA, Viewpoint("", EYE, None))
    assert blended.score > rendered.score
    assert rendered.score == pytest.approx(float(asker.own.max()), abs=1e-5)


@pytest.mark.parametrize("readout", READOUTS)
def test_queries_are_asked_by_name_and_in_batches(scene, monkeypatch, readout):
    asker, asked = Asker(scene, PAIR, LANGSPLAT.change(readout=readout)), ["right", "left", "right"]
    together = list(asker.ask(asked, CAMERA, Viewpoint("", EYE, None)))
    monkeypatch.setattr(text, "AT_ONCE", 1)
    alone = list(asker.ask(asked, CAMERA, Viewpoint("", EYE, None)))
    assert [one.phrase for one in together] == [one.phrase for one in alone] == asked
    for one, other in zip(together, alone, strict=True):
        assert one.score == pytest.approx(other.score, abs=1e-6) and one.pixel == other.pixel
    assert not list(asker.ask([], CAMERA, Viewpoint("", EYE, None)))


@pytest.fixture
def layered() -> QueryScene:
    """A thing at 2 m before a wall at 4 m, both wide and soft; level 0 knows only the wall, level 1 both."""
    both = blobs([[0.0, 0.0, 2.0], [0.0, 0.0, 4.0]], [0.98, 0.98], 0.3)
    both.log_scales[1] = torch.tensor([8.0, 8.0, 0.1]).log()
    code = torch.stack([torch.eye(4)[[1, 1]], torch.eye(4)[:2]], dim=1)
    share = torch.tensor([[0.0, 1.0], [1.0, 1.0]])
    return QueryScene(both, SETTINGS, CAMERA, 0, code, share, IDENTITY, ["part", "whole"])


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.7, 0.99])
def test_a_mask_is_what_the_matching_gaussians_fill_by_half(layered, threshold):
    """Wherever the threshold lies, as no Gaussian's relevancy lies between those of the thing and of the wall."""
    thing, _ = ask(layered, LANGSPLAT.change(box_filter=0.0, segmentation_threshold=threshold))
    image, covered = composite(gaussians_in(layered.gaussians, CAMERA, np.eye(4), SETTINGS), torch.eye(2))
    filled = (image[..., 0] / covered).numpy()
    assert (filled > 0.5).sum() > (filled > 0.7).sum() + 20
    np.testing.assert_array_equal(thing.mask, filled > 0.5)
    assert (thing.level, thing.mask_level) == ("whole", "whole")


def test_a_gaussian_counts_in_a_mask_by_its_share_and_equal_relevancies_have_no_mask(layered):
    whole, _ = ask(layered, LANGSPLAT.change(box_filter=0.0))
    layered.share[0, 1] = 0.2
    less, _ = ask(layered, LANGSPLAT.change(box_filter=0.0))
    assert 0 < less.mask.sum() < whole.mask.sum() and not (less.mask & ~whole.mask).any()
    layered.share[0, 1] = 1.0
    # A blend of equal values differs from them by rounding.
    layered.code[:] = torch.tensor([0.6, 0.8, 0.0, 0.0])
    for answer in ask(replace(layered), LANGSPLAT.change(segmentation_threshold=0.0)):
        assert answer.score > 0.5 and not answer.mask.any()


def test_a_view_of_nothing_has_no_answer(layered):
    for answer in ask(layered, LANGSPLAT, pose=np.diag([-1.0, 1.0, -1.0, 1.0])):
        assert (answer.score, answer.level, answer.pixel, answer.mask_level) == (0.0, None, None, None)
        assert not answer.mask.any()


def test_a_position_inverts_the_projection_at_any_resolution_of_the_depth():
    camera = Camera(64, 48, 50.0, 40.0, 30.0, 25.0)
    pose = make_pose(Rotation.from_euler("xyz", [0.3, -0.5, 0.2]).as_matrix(), np.array([1.0, -2.0, 3.0]))
    depth = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    for pixel, z in (((63, 47), 12.0), ((0, 0), 1.0), ((31, 20), 6.0)):
        local = transform(invert(pose), pixel_position(camera, pose, pixel, depth))
        assert local[2] == pytest.approx(z)
        np.testing.assert_allclose(camera.project(local), np.array(pixel) + 0.5, atol=1e-9)
