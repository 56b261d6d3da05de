"""PSNR and SSIM of parts of a picture."""

import math

import numpy as np
import pytest
import torch

from egosplat.evaluation.evaluation_frames import RegionScore, region_scores, regions, summarise_rendering
from egosplat.image_quality import ssim_map


@pytest.fixture
def photograph() -> np.ndarray:
    """(30, 40, 3) uint8 noise from 50 to 199."""
    return np.random.default_rng(0).integers(50, 200, (30, 40, 3), dtype=np.uint8)


@pytest.fixture
def valid(instance_map) -> np.ndarray:
    return instance_map >= 0


@pytest.fixture
def groups(instance_map, instances, valid) -> dict[str, np.ndarray]:
    return regions(instance_map, instances, valid)


def test_moving_instances_are_dynamic_and_all_else_static(instance_map, instances, groups, valid):
    np.testing.assert_array_equal(groups["dynamic"], np.isin(instance_map, (2, 3)))
    np.testing.assert_array_equal(groups["static"], np.isin(instance_map, (0, 1, 4)))
    np.testing.assert_array_equal(groups["all"], valid)
    # Also what nobody has annotated.
    everything = regions(instance_map, instances, np.ones(instance_map.shape, bool))
    assert everything["static"][:, :2].all() and everything["all"].all()
    nothing = regions(np.full((8, 8), -1, np.int32), [], np.ones((8, 8), bool))
    assert nothing["static"].all() and not nothing["dynamic"].any()


def test_an_error_is_where_it_is(photograph, valid, groups):
    """20 of 255 on what moves: 20 log10(255 / 20) dB there, and less by the share of pixels over all."""
    same = region_scores(photograph, photograph, valid, groups)
    assert {name: one.pixels for name, one in same.items()} == {"static": 1030, "dynamic": 110, "all": 1140}
    assert all(one.psnr == math.inf and one.ssim == pytest.approx(1.0, abs=1e-6) for one in same.values())
    render = photograph.copy()
    render[groups["dynamic"]] += 20
    found = region_scores(render, photograph, valid, groups)
    expected = 20 * math.log10(255 / 20)
    assert found["dynamic"].psnr == pytest.approx(expected, abs=1e-3) and found["static"].psnr == math.inf
    assert found["all"].psnr == pytest.approx(expected + 10 * math.log10(1140 / 110), abs=1e-3)
    assert found["dynamic"].ssim < found["all"].ssim < 1.0
    # The mean over pixels whose window is whole: their numbers weigh the parts.
    whole = ~ssim_map(*map(torch.from_numpy, (render, photograph, valid))).isnan().numpy()
    counts = {name: int((whole & own).sum()) for name, own in groups.items()}
    assert 0 < counts["dynamic"] < 110 and counts["static"] + counts["dynamic"] == counts["all"]
    parts = sum(counts[name] * found[name].ssim for name in ("static", "dynamic"))
    assert found["all"].ssim == pytest.approx(parts / counts["all"])
    # Pixels that are not valid do not count.
    render[~valid] = 255
    assert region_scores(render, photograph, valid, groups) == found


def test_the_mean_is_over_pictures_that_have_the_region():
    scores = [
        {"all": RegionScore(9, 20.0, 0.5), "dynamic": RegionScore(0, math.nan, math.nan)},
        {"all": RegionScore(9, 30.0, 0.7), "dynamic": RegionScore(4, 10.0, 0.1)},
        {"dynamic": RegionScore(4, 14.0, math.nan)},
        {},
    ]
    found = summarise_rendering(scores)
    assert found["all"] == {"frames": 2, "psnr": 25.0, "ssim": pytest.approx(0.6)}
    assert found["dynamic"] == {"frames": 2, "psnr": 12.0, "ssim": 0.1}  # the second has no whole window
    assert found["static"]["frames"] == 0 and math.isnan(found["static"]["psnr"])
