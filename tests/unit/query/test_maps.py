"""Relevancy maps that are given read like those that are rendered."""

import numpy as np
import pytest
import torch

from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.query.answer import View, answer_from_codes
from egosplat.query.maps import find_in_maps, find_peak
from egosplat.query.options import LANGSPLAT
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.text import Texts

SIZE = 48
OPTIONS = LANGSPLAT.change(box_filter=6 / SIZE, majority_filter=7 / SIZE)
ALL = np.ones((SIZE, SIZE), bool)


def disc(height: int, width: int, radius: float) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width]
    return (rows + 0.5 - height / 2) ** 2 + (columns + 0.5 - width / 2) ** 2 < radius**2


@pytest.mark.parametrize("small", [SIZE, SIZE // 2])
def test_an_answer_from_codes_is_that_of_its_maps(small):
    rng = np.random.default_rng(0)
    codes = torch.from_numpy(rng.normal(size=(2, small, small, 4)).astype(np.float32)).cumsum(1).cumsum(2)
    coverage = torch.from_numpy(rng.random((2, small, small)).astype(np.float32))
    decoder = Decoder((4,), np.zeros(0, np.float32))
    directions = torch.nn.functional.normalize(torch.from_numpy(rng.normal(size=(3, 4))).float(), dim=1)
    texts = Texts(("cup",), directions[:1], directions[1:])
    valid = disc(SIZE, SIZE, 22.0)
    options = OPTIONS.change(min_coverage=0.3)
    view = View(
        codes,
        coverage,
        torch.ones(small, small),
        Camera(SIZE, SIZE, 40.0, 40.0, 24.0, 24.0),
        np.eye(4),
        valid,
    )
    (answer,) = answer_from_codes(view, decoder, texts, options)

    seen = coverage > 0.3
    maps = relevancy_maps(codes, seen, decoder, texts, options.temperature)[0].numpy()
    maps = np.where(seen.numpy(), maps, np.float32(np.nan))
    found = find_in_maps(maps, valid, options)
    assert (found.location.level, found.segmentation.level) == (answer.level, answer.mask_level)
    assert found.location.pixel == answer.pixel
    assert found.location.score == pytest.approx(answer.score, rel=1e-6)
    np.testing.assert_array_equal(found.segmentation.mask, answer.mask)
    np.testing.assert_allclose(found.relevancy, answer.relevancy, rtol=1e-5)


def test_scaled_and_shifted_maps_say_the_same():
    maps = np.random.default_rng(1).random((3, SIZE, SIZE)).astype(np.float32)
    first, second = (find_in_maps(one, ALL, OPTIONS) for one in (maps, 0.25 * maps + 0.5))
    assert first.location.pixel == second.location.pixel
    assert (first.segmentation.mask != second.segmentation.mask).mean() < 0.01


@pytest.mark.parametrize("share", [0.0, 0.25, 0.7])
def test_a_threshold_lies_between_the_least_and_the_largest_relevancy_of_its_level(share):
    maps = np.full((2, SIZE, SIZE), 0.5, np.float32)
    maps[1, 10:30, 10:30], maps[1, :5], maps[0, 0, 0] = 0.9, 0.1, np.nan
    found = find_peak(maps, ALL, OPTIONS.change(segmentation_threshold=share))
    assert vars(found.location) == vars(find_in_maps(maps, ALL, OPTIONS).location)
    assert found.location.level == 1 and found.shown.all()
    assert found.threshold == pytest.approx(0.1 + 0.8 * share)
    # What is hidden, or not valid, moves nothing.
    maps[1, :5] = np.nan
    hidden = find_peak(maps, ALL, OPTIONS.change(segmentation_threshold=share))
    assert hidden.threshold == pytest.approx(0.5 + 0.4 * share)
    assert not hidden.shown[:5].any() and not hidden.relevancy[:5].any() and hidden.shown[5:].all()


def test_there_is_no_answer_outside_of_what_is_valid():
    valid = ALL.copy()
    valid[:, SIZE // 2 :] = False
    maps = np.full((1, SIZE, SIZE), 0.1, np.float32)
    maps[0, :, 30:] = 1.0
    maps[0, 10:20, 5:15] = 0.5
    found = find_in_maps(maps, valid, OPTIONS)
    assert 5 <= found.location.pixel[0] < 15 and 10 <= found.location.pixel[1] < 20
    assert not found.segmentation.mask[:, SIZE // 2 :].any() and found.segmentation.mask[12:18, 7:13].all()
    # What lies outside moves nothing inside.
    other = find_in_maps(np.where(valid, maps, np.float32(0.3)), valid, OPTIONS)
    np.testing.assert_array_equal(found.segmentation.mask, other.segmentation.mask)


def test_nothing_is_found_where_every_value_is_nan():
    for find in (find_in_maps, find_peak):
        assert find(np.full((2, SIZE, SIZE), np.nan, np.float32), ALL, OPTIONS) is None
        with pytest.raises(ValueError, match="maps"):
            find(np.zeros((SIZE, SIZE), np.float32), ALL, OPTIONS)
