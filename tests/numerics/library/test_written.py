"""Gaussians at the ends of float32 on the page, and a million of them."""

import numpy as np
import pytest
import torch

from egosplat.rasterize.api import rasterization
from egosplat.viewing.gaussians import pack_gaussians
from tests.support.page_scene import scales_of, wall


@pytest.mark.numerics("page: scales beside one of 1e-300 and one of 1e38 m, by their factor", within=0.05)
def test_scales(measured):
    gaussians = wall()
    gaussians.log_scales[:2] = torch.tensor([[np.log(1e-300)], [np.log(1e38)]])
    arrays, facts = pack_gaussians(gaussians, 1)
    measured(np.abs(scales_of(facts, arrays) / gaussians.scales.numpy() - 1)[2:].max())


@pytest.mark.numerics(
    "page: quaternions of length 1e-18 to 1e18", within=1e-2, outside="length 0: no direction"
)
def test_rotations(measured):
    gaussians = wall()
    truth = torch.nn.functional.normalize(gaussians.quats, dim=1)
    gaussians.quats[:] = truth * torch.logspace(-18, 18, len(truth))[:, None]
    gaussians.quats[0] = 0.0
    found = pack_gaussians(gaussians, 1)[0]["rotation"].T / 127.0
    assert not found[0].any()
    measured(np.abs(found - truth.numpy())[1:].max())


@pytest.mark.numerics("a million Gaussians, a thousand of them in view, against the thousand", within=0.0)
def test_a_million(measured):
    random, n = torch.Generator().manual_seed(0), 10**6
    means = torch.rand(n, 3, generator=random) * 2 - torch.tensor([1.0, 1.0, 4.0])
    means[:1000, 2] += 5.0
    values = [
        means,
        torch.eye(4)[:1].repeat(n, 1),
        torch.full((n, 3), 0.02),
        torch.full((n,), 0.5),
        means.sin(),
    ]
    camera = torch.eye(4)[None], torch.tensor([[[40.0, 0, 32], [0, 40, 32], [0, 0, 1]]]), 64, 64
    every, few = (rasterization(*(one[:count] for one in values), *camera)[0] for count in (n, 1000))
    assert every.abs().max() > 0.3
    measured(float((every - few).abs().max()))
