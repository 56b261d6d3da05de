"""GAGS' distillation against numbers worked out by hand."""

import math

import pytest
import torch

from egosplat.language.decoder import split_layers
from egosplat_rivals.gags import (
    HIDDEN,
    SCALES,
    SKIPS,
    Sample,
    entropy,
    mean_over_regions,
    regions,
    sample_regions,
    variance_within,
    weighted_target,
)
from egosplat_rivals.loop import Layers

CPU = torch.device("cpu")


def whole(region: torch.Tensor) -> Sample:
    return sample_regions(region, 2 * len(region) ** 2, torch.Generator().manual_seed(0))


def test_the_decoders_are_as_published_and_add_the_first_and_third_layer_and_those_and_the_sixth():
    assert len(Layers((16, *HIDDEN, 512), 0, CPU, skips=SKIPS).values) == 596_480
    assert len(Layers((16, *SCALES), 0, CPU).values) == 20_323
    layers, x = Layers((16, *HIDDEN, 5), 0, CPU, skips=SKIPS), torch.randn(3, 16)
    *hidden, (weights, biases) = split_layers(layers.values, (16, *HIDDEN, 5))
    outputs = [x]
    for number, (own_weights, own_biases) in enumerate(hidden, 1):
        found = (outputs[-1] @ own_weights.T + own_biases).relu()
        added = {3: outputs[1:2], 6: outputs[3:4]}.get(number, [])
        outputs.append(sum(added, found))
    torch.testing.assert_close(layers(x), outputs[-1] @ weights.T + biases)


def test_entropy_of_equal_weights():
    assert float(entropy(torch.full((7, 3), 1 / 3))) == pytest.approx(math.log(3) / 3, abs=1e-5)
    assert float(entropy(torch.eye(3))) == pytest.approx(0.0, abs=1e-5)


def test_a_small_region_counts_as_much_as_a_large_one():
    region = torch.tensor([4] * 10 + [9] * 1000)
    losses = (region == 4).float()
    sample = whole(region)
    assert float(mean_over_regions(losses[sample.pixel], sample)) == pytest.approx(0.5)


def test_sampled_regions_have_the_mean_of_all_pixels():
    draw = torch.Generator().manual_seed(0)
    region = torch.randint(-1, 40, (4000,), generator=draw)
    values = torch.rand(4000, generator=draw) + 0.1 * region
    everything = whole(region)
    wanted = float(mean_over_regions(values[everything.pixel], everything))
    found = []
    for _ in range(100):
        sample = sample_regions(region, 30, draw)  # fewer than two pixels a region
        assert len(sample.pixel) == 30 and int(region[sample.pixel].min()) >= 0
        found.append(float(mean_over_regions(values[sample.pixel], sample)))
    error = 4 * float(torch.tensor(found).std()) / 10
    assert wanted == pytest.approx(float(torch.tensor(found).mean()), abs=error)


def test_variance_of_two_pixels_in_one_of_the_channels_and_nothing_without_regions():
    values = torch.zeros(5, 16)
    values[1, 3] = 1.0
    sample = whole(torch.tensor([0, 0, 1, -1, -1]))  # region 1 has one pixel
    found = variance_within(values[sample.pixel], sample, pixels=400)
    assert float(found) == pytest.approx(2 * 0.5 / 16 / 400)
    nothing = whole(torch.tensor([-1, -1]))
    assert float(mean_over_regions(torch.zeros(0), nothing)) == 0.0
    assert float(variance_within(torch.zeros(0, 2), nothing, 4)) == 0.0


def test_a_pixel_without_a_level_has_no_target_and_weights_get_a_gradient_through_it():
    weights = torch.tensor([[0.5, 0.25, 0.25]] * 2, requires_grad=True)
    features = torch.eye(3)[:, None].repeat(1, 2, 1)
    known = torch.tensor([[True, True], [True, False], [True, True]])
    target = weighted_target(weights, features, known)
    assert target.tolist() == [[0.5, 0.25, 0.25], [0.0, 0.0, 0.0]]
    target.sum().backward()
    assert weights.grad[0].abs().sum() > 0 and weights.grad[1].abs().sum() == 0


def test_regions_are_the_instances_of_the_level_that_prevails_around_a_pixel():
    weights = torch.zeros(9, 9, 3)
    weights[..., 1] = 1.0
    weights[4, 4] = torch.tensor([1.0, 0.0, 0.0])  # alone among its neighbors
    labels = torch.stack([torch.full((9, 9), 7), torch.full((9, 9), 3), torch.full((9, 9), -1)])
    assert regions(weights, labels).unique().tolist() == [3]
    weights[..., :] = torch.tensor([0.0, 0.1, 0.9])
    assert regions(weights, labels).unique().tolist() == [-1]
