"""Relocation formulas of 3DGS-MCMC: shared opacity and scale, and the limit of copies per host."""

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.gaussians.mcmc import draw_hosts, most_copies, relocated

DEAD = 0.005


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("opacity", [0.006, 0.3, 0.9, 0.999, 1.0])
@pytest.mark.parametrize("copies", [1, 2, 5, 51, 1000])
def test_relocated_ones_keep_the_transmittance_and_the_profiles_integral(opacity: float, copies: int) -> None:
    new, factor = (float(t[0]) for t in relocated(torch.tensor([opacity]), torch.tensor([copies])))
    opacity = min(opacity, 1 - 1e-6)
    assert (1 - new) ** copies == pytest.approx(1 - opacity, rel=1e-4)
    # Along a line through the middle: the accumulated alpha of the copies sums up to the original's.
    x = np.linspace(-12, 12, 40_001)
    accumulated = 1 - (1 - new * np.exp(-0.5 * x**2)) ** copies
    original = opacity * np.exp(-0.5 * x**2)
    assert factor * accumulated.sum() == pytest.approx(original.sum(), rel=1e-5)


def test_hosts_are_drawn_by_opacity_and_by_seed() -> None:
    opacities = torch.tensor([0.9, 0.3, 0.0, 0.6])
    live = torch.tensor([True, True, False, True])
    hosts = draw_hosts(opacities, live, 9_000, 1e-6, seeded())
    shares = torch.bincount(hosts, minlength=4) / 9_000
    torch.testing.assert_close(shares, torch.tensor([0.5, 1 / 6, 0.0, 1 / 3]), atol=0.02, rtol=0.0)
    assert torch.equal(hosts, draw_hosts(opacities, live, 9_000, 1e-6, seeded()))
    assert not torch.equal(hosts, draw_hosts(opacities, live, 9_000, 1e-6, seeded(5)))
    assert draw_hosts(opacities, live, 0, DEAD, seeded()).shape == (0,)


@pytest.mark.parametrize("opacity", [0.0056, 0.0145, 0.1, 0.9, 1.0])
def test_most_copies_leaves_all_of_them_alive_and_one_more_would_not(opacity: float) -> None:
    n = int(most_copies(torch.tensor([opacity]), DEAD)[0])
    shared = [float(relocated(torch.tensor([opacity]), torch.tensor([k]))[0][0]) for k in (n, n + 1)]
    assert shared[0] > 1.09 * DEAD and shared[1] < 1.11 * DEAD


def test_no_host_is_drawn_more_often_than_it_can_share() -> None:
    opacities = torch.tensor([0.1, 0.0145, 0.006])
    hosts = draw_hosts(opacities, torch.ones(3, dtype=torch.bool), 5_000, DEAD, seeded())
    assert torch.bincount(hosts, minlength=3).tolist() == [18, 1, 0]


def test_relocation_needs_a_living_gaussian() -> None:
    for n in (0, 3):
        with pytest.raises(UserError, match=f"{n} Gaussians"):
            draw_hosts(torch.full((n,), 0.001), torch.zeros(n, dtype=torch.bool), 2, DEAD, seeded())
