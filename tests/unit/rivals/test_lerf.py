"""LERF's field against numbers worked out by hand."""

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from egosplat.language.decoder import decode
from egosplat_rivals.hash_grid import ENTRIES, FEATURES, RESOLUTIONS, HashGrid, contract, corners
from egosplat_rivals.lerf import (
    center_and_unit,
    evaluate_at_centers,
    feature_loss,
    input_scale,
    learning_rate,
)

SPREAD, AXIS, TURNED = torch.full((1, 100), 0.1), torch.eye(1, 100), torch.tensor([1.0, -1.0]).repeat(50)


def test_loss_of_unit_vectors():
    """The last is Huber's linear part."""
    pairs = (SPREAD, SPREAD), (SPREAD, SPREAD * TURNED), (SPREAD, -SPREAD), (AXIS, -AXIS)
    losses = [float(feature_loss(*pair)) for pair in pairs]
    assert losses == pytest.approx([0.0, 0.1, 0.2, 0.171875], abs=1e-6)


def test_the_scale_doubles_with_the_distance():
    near, far = input_scale(torch.full((2,), 0.5), torch.tensor([1.0, 2.0]), height=512, focal=256.0)
    assert float(near) == pytest.approx(1.0) and float(far) == pytest.approx(2.0)


def test_contraction_of_far_points():
    points = torch.tensor([[2.0, 0, 0], [0.5, 0, 0], [0, 0, 0], [0, 1e30, 0]])
    found = contract(points)
    torch.testing.assert_close(found[:3, 0], torch.tensor([0.875, 0.625, 0.5]))
    assert float(found[3, 1]) == pytest.approx(1.0) and bool(found.isfinite().all())


def test_the_world_has_its_farthest_camera_at_one():
    positions = np.array([[1.0, 0, 0], [3.0, 0, 0], [8.0, 0, 0]])
    center, unit = center_and_unit(positions)
    assert center.tolist() == [4.0, 0.0, 0.0] and unit == 4.0
    assert center_and_unit(positions[:1])[1] == 1.0  # cameras at one place
    assert center_and_unit(1e-7 * positions)[1] == pytest.approx(1e-7 * unit)


def test_the_grid_has_its_resolutions_and_interpolates_between_corners():
    assert RESOLUTIONS[0] == 16 and RESOLUTIONS[11] in (127, 128) and RESOLUTIONS[23] in (511, 512)
    grid = HashGrid(torch.Generator().manual_seed(0))
    grid.table.data[:ENTRIES] = torch.arange(ENTRIES)[:, None].float()  # the first level, which has no hash
    side = RESOLUTIONS[0] + 1
    found = grid(torch.tensor([[1.5, 2.25, 3.0]]) / RESOLUTIONS[0])[0]
    assert found.shape == (len(RESOLUTIONS) * FEATURES,)
    assert float(found[0]) == pytest.approx(1.5 + side * (2.25 + side * 3.0), rel=1e-5)


@pytest.mark.parametrize("at", [0.0, 1.0, 0.37])
def test_weights_of_corners_add_up_to_one_at_every_edge(at):
    entries, weights = corners(torch.full((1, 3), at))
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(1, len(RESOLUTIONS)))
    levels = entries // ENTRIES
    assert torch.equal(levels, torch.arange(len(RESOLUTIONS))[:, None].expand(-1, 8)[None])


def test_the_rate_falls_over_four_thousand_steps():
    rates = [learning_rate(step) for step in (0, 2000, 4000, 9000)]
    assert rates == pytest.approx([1e-2, 10**-2.5, 1e-3, 1e-3])


def test_baked_codes_decode_to_the_field():
    """A field of few directions fits a basis of as many numbers."""
    draw = torch.Generator().manual_seed(0)
    centers = F.normalize(torch.randn(3, 16, generator=draw), dim=1)
    means = torch.randn(200, 3, generator=draw)

    def field(points, scale):
        return F.normalize(points.softmax(dim=1) @ centers + scale[:, None] * centers[0], dim=1)

    scales = torch.tensor([0.0, 0.7, 1.5])
    code, decoder = evaluate_at_centers(field, means, scales, 3)
    assert code.shape == (200, 3, 3)
    for level, scale in enumerate(scales):
        wanted = field(means, scale.expand(200))
        assert float((decode(code[:, level], decoder) * wanted).sum(dim=1).min()) > 0.999
