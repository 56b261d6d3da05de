"""Splat Feature Solver: what its definition says, in scenes of few Gaussians; and LangSplatV2: four words a code, and no gradient for the
others."""

import sys

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import Targets
from egosplat.pipeline.config import defaults, stage_values
from egosplat_rivals import splat_feature_solver as solver
from egosplat_rivals.langsplat_v2 import WORDS, codebook, coefficients
from egosplat_rivals.splat_feature_solver import (
    SHARPENING,
    agreeing,
    clusters_of,
    lift,
    lift_clusters,
    mask_means,
    principal_components,
    sharpen,
)
from tests.support.splats import blobs
from tests.unit.rivals.test_center_methods import CAMERA, LEFT, RIGHT, look, plane

NOTHING = [0.0, 0.0]

# Rows and columns that show the two patches of ``HALVES``.
SHOWN, LEFT_HALF, RIGHT_HALF = slice(10, 38), slice(2, 30), slice(34, 62)


@pytest.fixture(autouse=True)
def small_clusters(monkeypatch):
    monkeypatch.setattr(solver, "LEAST", 20)


class Masks:
    """Stands for ``CodeTargets``: a left and a right mask in each view, instances 2 v and 2 v + 1, with given codes."""

    def __init__(self, codes: list[tuple[list[float], list[float]]], unit_norm: bool = False) -> None:
        self.codes, self.unit_norm = torch.tensor(codes).flatten(0, 1), unit_norm
        self.levels, self.channels = ["whole"], self.codes.shape[1]
        self.painted = torch.full((len(codes), 1, CAMERA.height, CAMERA.width), -1)
        for view, picture in enumerate(self.painted[:, 0]):
            picture[SHOWN][:, LEFT_HALF], picture[SHOWN][:, RIGHT_HALF] = 2 * view, 2 * view + 1

    def labels(self, frame: int) -> torch.Tensor:
        return self.painted[frame]

    def of_labels(self, frame: int, labels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        codes = torch.where((labels >= 0)[..., None], self.codes[labels], 0.0)
        return codes, (codes != 0).any(-1)

    def of(self, frame: int) -> Targets:
        codes, known = self.of_labels(frame, self.labels(frame))
        return Targets(codes.movedim(-1, 1), known)


# Two patches that fill the left and the right half of a picture, and whether each Gaussian is on the right.
HALVES = Gaussians.concatenate([plane(2.0, x=-0.55), plane(2.0, x=0.55)])
ON_RIGHT = torch.arange(HALVES.count) >= HALVES.count // 2
SQUARES = torch.where(ON_RIGHT[:, None], torch.tensor(RIGHT), torch.tensor(LEFT))


def look_at(gaussians: Gaussians, masks: Masks):
    return look(gaussians, type("Frames", (), {"codes": masks.painted, "of": masks.of}))


def coded(gaussians: Gaussians, masks: Masks, **changes: object):
    options = LanguageOptions(**stage_values("language", defaults()) | {"method": "clustered"} | changes)
    return lift_clusters(look_at(gaussians, masks), masks, options)


def test_a_cluster_takes_the_mean_of_the_masks_that_agree_with_it_each_counting_once():
    """Lifting weights each view by what it shows; a mean of masks does not."""
    tilted = [0.6, 0.8]
    mean = coded(HALVES, Masks([(LEFT, RIGHT), (tilted, RIGHT)])).code[~ON_RIGHT, 0]
    torch.testing.assert_close(mean, torch.tensor([0.8, 0.4]).expand(len(mean), 2))
    unit = coded(HALVES, Masks([(LEFT, RIGHT), (tilted, RIGHT)], unit_norm=True)).code[~ON_RIGHT, 0]
    torch.testing.assert_close(unit, torch.tensor([2.0, 1.0]).expand(len(unit), 2) / 5**0.5)


def test_a_mask_that_disagrees_with_its_cluster_does_not_count():
    """In the third view, one mask covers both squares: half of it is the cluster of either."""
    masks = Masks([(LEFT, RIGHT), (LEFT, RIGHT), ([0.5, 0.5], NOTHING)])
    masks.painted[2][masks.painted[2] >= 0] = 4
    lifted = lift(look_at(HALVES, masks))[0][:, 0]
    torch.testing.assert_close(lifted[0], torch.tensor([5 / 6, 1 / 6]))
    torch.testing.assert_close(coded(HALVES, masks).code[:, 0], SQUARES)


def test_gaussians_of_a_cluster_that_no_mask_agrees_with_keep_their_lifted_code():
    """Two masks, above and below, share the left square, so that none of them is its cluster."""
    masks = Masks([(LEFT, RIGHT), (LEFT, RIGHT)])
    masks.painted[0, 0, : CAMERA.height // 2, LEFT_HALF] = 2
    masks.painted[1, 0] = -1
    found = coded(HALVES, masks)
    code, share = lift(look_at(sharpen(HALVES), masks))
    assert torch.equal(found.code[~ON_RIGHT], code[~ON_RIGHT]) and torch.equal(found.share, share)


def test_masks_without_a_code_do_not_count():
    masks = Masks([(LEFT, RIGHT), (NOTHING, RIGHT)])
    means, known = mask_means(look_at(HALVES, masks), masks, ON_RIGHT.long()[:, None])
    torch.testing.assert_close(means[0], torch.tensor([LEFT, RIGHT, NOTHING]))
    assert known.tolist() == [[True, True, False]]


def test_a_missing_library_is_reported_before_anything_is_computed(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.cluster", None)
    with pytest.raises(UserError, match=r"egosplat\[clusters\]"):
        lift_clusters(None, None, None)


@pytest.mark.parametrize("agreement, counts", [(81, [7]), (80, [])])
def test_a_mask_agrees_above_an_iou_of_four_fifths(agreement, counts):
    """Of 100 pixels of cluster 3, and the rest of the picture in none."""
    shown, masks = torch.full((2, 20, 20), -1)
    shown[:5] = 3
    masks.view(-1)[:agreement] = 7
    names, cluster = agreeing(masks, shown, None)
    assert names.tolist() == counts and cluster.tolist() == [3] * len(counts)


def test_pixels_that_do_not_count_are_no_part_of_the_overlap():
    shown, weight = torch.zeros(4, 4, dtype=torch.int64), torch.ones(4, 4)
    masks = torch.full((4, 4), -1)
    masks[:2], weight[2:] = 5, 0.0
    assert agreeing(masks, shown, None)[0].tolist() == []
    assert agreeing(masks, shown, weight)[0].tolist() == [5]
    assert agreeing(masks, shown, torch.zeros(4, 4))[0].tolist() == []


def test_sharpening_scales_logits_and_is_finite_at_opacities_0_and_1():
    row = blobs([[0.1 * x, 0.0, 2.0 + 0.1 * x] for x in range(5)], [0.0, 0.3, 0.5, 0.8, 1.0])
    sharp = sharpen(row).opacities
    assert sharp[[0, 2, 4]].tolist() == [0.0, 0.5, 1.0]
    assert float(sharp[1]) < 0.3 and float(sharp[3]) > 0.8
    torch.testing.assert_close(torch.logit(sharp[3]), SHARPENING * torch.logit(torch.tensor(0.8)))
    found = coded(row, Masks([(LEFT, RIGHT)] * 2))
    assert bool(found.code.isfinite().all()) and bool(found.share.isfinite().all())
    assert float(found.share[0]) == 0.0 and float(found.share[4]) > 0.0


def groups(sizes: list[int], spread: float = 1e-3) -> torch.Tensor:
    """Codes near the axes of three dimensions, so many each."""
    draw = torch.Generator().manual_seed(0)
    return torch.cat([torch.eye(3)[axis].expand(size, 3) for axis, size in enumerate(sizes)]) + (
        spread * torch.randn(sum(sizes), 3, generator=draw)
    )


def test_groups_of_codes_are_clusters_and_small_ones_and_those_without_a_code_are_none():
    equal = groups([30, 30, 0], spread=0.0)
    assert clusters_of(equal, torch.ones(60), 0).unique().tolist() == [0, 1]
    found = clusters_of(groups([60, 40, 8]) * torch.tensor([1.0, 1.0, 10.0]), torch.ones(108), 0)
    first, second, third = found.split([60, 40, 8])
    assert {*first.tolist()} | {*second.tolist()} == {0, 1}
    assert len(first.unique()) == len(second.unique()) == 1 and third.tolist() == [-1] * 8
    share = torch.arange(100) % 2.0
    assert torch.equal(clusters_of(groups([60, 40, 0]), share, 0) >= 0, share > 0)
    assert clusters_of(torch.zeros(0, 3), torch.zeros(0), 0).tolist() == []


def test_others_take_the_cluster_of_the_nearest_one_of_the_sample(monkeypatch):
    monkeypatch.setattr(solver, "SAMPLE", 70)
    code = groups([90, 60, 0])
    found = clusters_of(code, torch.ones(150), 3)
    first, second = found.split([90, 60])
    assert len(first.unique()) == len(second.unique()) == 1 and found.unique().tolist() == [0, 1]
    assert torch.equal(found, clusters_of(code, torch.ones(150), 3))


@pytest.mark.parametrize("spread", [0.0, 1e-30])
def test_codes_without_any_spread_are_no_clusters_and_no_error(spread):
    same = torch.ones(60, 4) + spread * torch.randn(60, 4)
    with np.errstate(all="raise"):
        assert clusters_of(same, torch.ones(60), 0).tolist() == [-1] * 60


def test_principal_components_keep_distances_in_the_directions_of_most_variance(monkeypatch):
    draw = torch.Generator().manual_seed(0)
    flat = torch.randn(200, 2, generator=draw) @ torch.randn(2, 6, generator=draw) + 100.0
    monkeypatch.setattr(solver, "COMPONENTS", 2)
    parts = torch.from_numpy(principal_components(flat, torch.arange(200)))
    assert parts.shape == (200, 2)
    exact = torch.cdist(flat.double(), flat.double())
    found = torch.cdist(parts.double(), parts.double())
    torch.testing.assert_close(found / found.max(), exact / exact.max(), atol=1e-4, rtol=0)


def test_a_code_is_the_softmax_cut_to_four_over_its_sum_and_no_other_logit_gets_a_gradient():
    draw = torch.Generator().manual_seed(0)
    logits = torch.randn(50, WORDS, generator=draw).requires_grad_()
    words = torch.randn(WORDS, 16, generator=draw)
    code = coefficients(logits)
    whole = logits.detach().softmax(dim=-1)
    chosen = whole >= whole.topk(4, dim=-1).values[:, -1:]
    torch.testing.assert_close(code.detach(), whole * chosen / (whole * chosen).sum(dim=-1, keepdim=True))
    (code @ words).square().sum().backward()
    assert float(logits.grad[~chosen].abs().max()) < 1e-8 < float(logits.grad[chosen].abs().min())


def test_the_codebook_holds_the_centers_of_clusters():
    rng = np.random.default_rng(0)
    centers = np.eye(WORDS, 80, dtype=np.float32)
    rows = np.repeat(centers, 20, axis=0) + rng.normal(0, 1e-3, (20 * WORDS, 80)).astype(np.float32)
    found = codebook(rows, seed=0)
    assert found.shape == (WORDS, 80)
    nearest = np.linalg.norm(found[:, None] - centers, axis=-1).min(axis=1)
    assert np.median(nearest) < 0.01
    np.testing.assert_array_equal(found, codebook(rows, seed=0))


def test_few_different_features_are_the_codebook_and_none_is_an_error():
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]], np.float32)
    assert sorted(map(tuple, codebook(rows, 0))) == [(0.0, 1.0), (1.0, 0.0)]
    with pytest.raises(UserError, match=r"language\.method"):
        codebook(rows[:0], 0)
