"""Many Gaussians, large images, and gradients against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.rasterize import cpu
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference.projection import project
from egosplat.rasterize.reference.rasterizer import composite
from tests.numerics.rasterize.conftest import weights_of
from tests.support.splats import undecided

LARGE, WINDOW = 4096, 24
CORNERS = [(0, 0), (LARGE - WINDOW, LARGE - WINDOW), (2036, 2040), (0, LARGE - WINDOW)]


@pytest.mark.numerics("200 Gaussians of all sizes and opacities", within=2e-5)
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("seed", range(3))
def test_a_random_cloud(cloud, compare, measured, mode, seed):
    both = compare(cloud(seed, 200), rasterize_mode=mode)
    assert both.decided.float().mean() > 0.8
    measured(both.error)


def stacked(gaussian, count: int, opacities: torch.Tensor) -> dict[str, torch.Tensor]:
    """Gaussians smaller than a pixel, all in the middle of the 5 x 5 image, at 1 to 3 m."""
    rng = np.random.default_rng(0)
    depth = np.sort(rng.uniform(1.0, 3.0, count))
    return gaussian(
        means=np.stack([0.001 * depth, -0.002 * depth, depth], axis=1),
        quats=rng.normal(size=(count, 4)),
        scales=np.exp(rng.uniform(-9.0, -5.0, (count, 3))),
        opacities=opacities,
        colors=rng.uniform(size=(count, 3)),
        Ks=[[[30.0, 0, 2.5], [0, 30.0, 2.5], [0, 0, 1]]],
    )


OPACITIES = pytest.mark.parametrize(("low", "high"), [(0.01, 0.01), (0.0, 1.0), (1.0, 1.0)])


@pytest.mark.numerics(
    "10,000 Gaussians on a pixel, opacity 0.01, 1, or 0 to 1: image, gradients by Gaussians",
    within=1e-4,
    outside="the first Gaussian that would lower the transmittance to 1e-4 ends the pixel",
)
@OPACITIES
def test_ten_thousand_gaussians_on_one_pixel(gaussian, compare, measured, low, high):
    opacities = np.random.default_rng(1).uniform(low, high, 10_000)
    both = compare(stacked(gaussian, 10_000, opacities), 5, 5)
    assert both.found.image[2, 2, -1] > 0.99 and both.decided[2, 2]
    measured(both.image_error)
    measured(both.shape_error)
    assert not both.found.gradients["colors"][-1].any()


@pytest.mark.numerics("the same: gradient by the pose", within=2e-2, outside="errors of 900 Gaussians add up")
@OPACITIES
def test_pose_gradient_with_ten_thousand_gaussians(gaussian, compare, measured, low, high):
    opacities = np.random.default_rng(1).uniform(low, high, 10_000)
    measured(compare(stacked(gaussian, 10_000, opacities), 5, 5).pose_error)


@pytest.mark.numerics("10,000 equal Gaussians at one depth", within=1e-4, outside="composited in their order")
def test_gaussians_at_equal_depths_keep_their_order(gaussian, compare, measured):
    count = 10_000
    values = gaussian(
        means=[[0.0, 0.0, 2.0]] * count,
        quats=[[1.0, 0.0, 0.0, 0.0]] * count,
        scales=[[1e-3] * 3] * count,
        opacities=[0.05] * count,
        colors=np.linspace(0, 1, 3 * count).reshape(count, 3),
        Ks=[[[30.0, 0, 2.5], [0, 30.0, 2.5], [0, 0, 1]]],
    )
    both = compare(values, 5, 5)
    measured(both.image_error)
    measured(both.shape_error)
    met = both.found.gradients["colors"].abs().sum(dim=1) > 0
    assert met[: int(met.sum())].all()


@pytest.mark.numerics("no Gaussian", outside="background only")
def test_no_gaussians_render_nothing(gaussian, compare):
    values = {name: value if name in ("viewmats", "Ks") else value[:0] for name, value in gaussian().items()}
    found = compare(values | {"backgrounds": torch.tensor([[0.2, 0.5, 0.9]])}).found
    assert (found.image == torch.tensor([0.2, 0.5, 0.9, 0.0])).all()
    assert found.gradients["means"].shape == (0, 3)


@pytest.mark.numerics(
    "image of 4096x4096 px, 300 Gaussians, compared in four windows of 24x24 px",
    within=2e-4,
    outside="float32 resolves 2e-4 px there",
)
def test_a_large_image(gaussian, measured):
    rng = np.random.default_rng(2)
    count = 300
    corner = np.array(CORNERS)[rng.integers(len(CORNERS), size=count)] + rng.uniform(0, WINDOW, (count, 2))
    depth = rng.uniform(2.0, 3.0, (count, 1))
    values = gaussian(
        means=np.hstack([(corner - LARGE / 2) / 4000 * depth, depth]),
        quats=rng.normal(size=(count, 4)),
        scales=np.exp(rng.uniform(-8.0, -5.0, (count, 3))),
        opacities=rng.uniform(0.05, 0.9, count),
        colors=rng.uniform(size=(count, 3)),
        Ks=[[[4000.0, 0, LARGE / 2], [0, 4000.0, LARGE / 2], [0, 0, 1]]],
    )
    found = {name: value.clone().requires_grad_(name != "Ks") for name, value in values.items()}
    truth = {name: value.detach().double().requires_grad_(name != "Ks") for name, value in values.items()}
    image, alpha, _ = cpu.rasterization(Arguments(**found, width=LARGE, height=LARGE))
    assert image.shape == (1, LARGE, LARGE, 3) and alpha.isfinite().all()
    exact = _windows(truth)
    sums = [0.0, 0.0]
    for (x, y), (expected, meta) in zip(CORNERS, exact, strict=True):
        seen = image[0, y : y + WINDOW, x : x + WINDOW]
        decided = ~undecided(meta)[0][..., None]
        assert expected.any()
        measured(float(((seen - expected).abs() * decided).detach().max()))
        weights = weights_of(expected.shape) * decided
        sums = [sums[0] + (seen * weights.float()).sum(), sums[1] + (expected * weights).sum()]
    for total in sums:
        total.backward()
    for name in ("means", "quats", "scales", "opacities", "colors", "viewmats"):
        measured(float((found[name].grad - truth[name].grad).norm() / truth[name].grad.norm()))


def _windows(values: dict[str, torch.Tensor]) -> list[tuple[torch.Tensor, dict[str, object]]]:
    """The reference's render of each window: projected for the large image, composited in the window only."""
    p = project(Arguments(**values, width=LARGE, height=LARGE), 0)
    results = []
    for corner in CORNERS:
        seen = replace(p, means2d=p.means2d - p.means2d.new_tensor(corner))
        image, _ = composite(seen, values["colors"], WINDOW, WINDOW)
        meta = {name: value[None].detach() for name, value in vars(seen).items()}
        results.append((image, meta | {"width": WINDOW, "height": WINDOW}))
    return results
