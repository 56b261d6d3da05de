"""Extreme sizes, proportions, rotations and opacities of a Gaussian."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates

TURNS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-2)
MODES = pytest.mark.parametrize("mode", ["classic", "antialiased"])


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    """10 to the power of ``low`` ... ``high``."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


IMAGE = pytest.mark.numerics(
    "image: three scales of 1e-8 to 1e4 m, any rotation, mode classic",
    within=3e-6,
    outside="drawn up to 1e18 m",
)
DIMMED = pytest.mark.numerics(
    "image: the same, mode antialiased", within=1e-5, outside="alpha below 1/255: culled"
)


@pytest.mark.parametrize(
    "mode", [pytest.param("classic", marks=IMAGE), pytest.param("antialiased", marks=DIMMED)]
)
@given(scales=st.tuples(*[decades(-8, 4)] * 3), turn=TURNS)
def test_image_of_any_scales(gaussian, compare, measured, mode, scales, turn):
    measured(compare(gaussian(scales=[scales], quats=[turn]), rasterize_mode=mode).image_error)


@pytest.mark.numerics(
    "gradients: three scales of 1e-8 to 1e4 m, within a factor of 3", within=1e-5, outside="else: finite"
)
@MODES
@given(size=decades(-8, 4), turn=TURNS)
def test_gradients_of_any_scale(gaussian, compare, measured, mode, size, turn):
    scales = [[size, 2 * size, 3 * size]]
    measured(compare(gaussian(scales=scales, quats=[turn]), rasterize_mode=mode).gradient_error)


@pytest.mark.numerics(
    "gradients: needle 1e-8 m thin, 1e-4 to 1e4 m long", within=1e-4, outside="else: finite"
)
@given(length=decades(-4, 4), turn=TURNS)
def test_elongated_gaussians(gaussian, compare, measured, length, turn):
    measured(compare(gaussian(scales=[[length, 1e-8, 1e-8]], quats=[turn])).gradient_error)


@pytest.mark.numerics("gradients: disc 1e-8 m thin, 1e-4 to 1e4 m wide, any rotation", within=1e-4)
@MODES
@given(width=decades(-4, 4), turn=TURNS)
def test_flat_gaussians(gaussian, compare, measured, mode, width, turn):
    values = gaussian(scales=[[width, 0.7 * width, 1e-8]], quats=[turn])
    measured(compare(values, rasterize_mode=mode).gradient_error)


@pytest.mark.numerics("disc seen exactly edge-on", within=1e-5)
@MODES
def test_a_flat_gaussian_seen_from_its_edge(gaussian, compare, measured, mode):
    measured(compare(gaussian(scales=[[1.0, 0.8, 1e-8]], quats=[[1, 0, 1, 0]]), rasterize_mode=mode).error)


@pytest.mark.numerics("scale 0", within=1e-6, outside="classic: as wide as eps2d; antialiased: culled")
@MODES
def test_scales_of_zero(gaussian, compare, measured, mode):
    both = compare(gaussian(scales=[[0.0] * 3]), rasterize_mode=mode)
    measured(both.image_error)
    assert all(gradient.isfinite().all() for gradient in both.found.gradients.values())
    assert bool(both.found.image.any()) == (mode == "classic")


@pytest.mark.numerics("scale of 1e19 m to infinity, NaN", outside="not drawn; finite gradients")
@pytest.mark.parametrize("scale", [1e19, 1e30, float("inf"), float("nan")])
def test_scales_larger_than_any_scene(gaussian, compare, scale):
    found = compare(gaussian(scales=[[scale] * 3])).found
    assert not found.image.any()
    assert all(gradient.isfinite().all() for gradient in found.gradients.values())


@pytest.mark.numerics("quaternion length of 1e-37 to 1e37", within=1e-5, outside="0, not finite: culled")
@given(length=decades(-37, 37), turn=TURNS)
def test_quaternions_of_any_length(gaussian, compare, measured, length, turn):
    measured(compare(gaussian(quats=torch.tensor([turn], dtype=torch.float64) * length)).error)


@pytest.mark.numerics(
    "quaternion length 1e-40 (subnormal)",
    within=1e-5,
    outside="gradient overflows float32; the optimizer skips the Gaussian",
)
def test_a_subnormal_quaternion(gaussian, compare, measured):
    both = compare(gaussian(quats=[[9e-41, 1e-41, 2e-41, 3e-41]]))
    measured(both.image_error)
    raw = Gaussians(
        both.values["means"].clone(),
        both.values["quats"].clone(),
        both.values["scales"].log(),
        both.values["opacities"].logit(),
        torch.zeros(1, 1, 3),
        torch.zeros(1, 0),
    ).requires_grad_()
    optimizer = Adam(raw, LearningRates(means=1.0))
    raw.means.grad, raw.quats.grad = both.found.gradients["means"], both.found.gradients["quats"]
    optimizer.step(None)
    assert optimizer.skipped_rows == 1 and torch.equal(raw.means.detach(), both.values["means"])


@pytest.mark.numerics("opacity of 0.004 to 1", within=2e-5, outside="alpha at most 0.999")
@given(opacity=st.one_of(st.floats(0.004, 1.0), st.sampled_from([0.004, 0.998, 0.9991, 1.0])))
def test_opacities(gaussian, compare, measured, opacity):
    measured(compare(gaussian(opacities=[opacity])).error)


@pytest.mark.numerics("opacity 1 at a pixel's center", within=1e-6, outside="alpha 0.999, gradient 0")
def test_opacity_of_one(gaussian, compare, measured):
    values = gaussian(
        means=[[0.0, 0.0, 2.0]], opacities=[1.0], Ks=[[[30.0, 0, 0.5], [0, 30.0, 0.5], [0, 0, 1]]]
    )
    both = compare(values, 1, 1)
    for each in (both.found, both.truth):
        measured(float((each.image[0, 0, -1] - 0.999).abs()))
    assert not both.found.gradients["opacities"].any() and both.found.gradients["colors"].any()


@pytest.mark.numerics(
    "quaternion length 0 or infinity; opacity 0, below 1/255, negative",
    outside="culled: radius and gradient 0",
)
@pytest.mark.parametrize(
    "changes",
    [{"quats": [[length, 0.0, 0.0, 0.0]]} for length in (0.0, float("inf"), float("nan"))]
    + [{"opacities": [opacity]} for opacity in (0.0, 1e-38, 0.0039, -1.0)],
)
def test_invalid_rotations_and_small_opacities_hide_the_gaussian(gaussian, compare, changes):
    both = compare(gaussian(**changes))
    for each in (both.found, both.truth):
        assert not each.image.any() and not each.meta["radii"].any()
        assert not any(gradient.any() for gradient in each.gradients.values())


@pytest.mark.numerics("opacity above 1", within=1e-5, outside="alpha at most 0.999")
def test_opacities_above_one(gaussian, compare, measured):
    both = compare(gaussian(opacities=[50.0]))
    measured(both.image_error)
    assert float(both.found.image[..., -1].max()) <= 0.9990001


@pytest.mark.numerics(
    "NaN or infinity in a Gaussian beside a valid one",
    within=1e-5,
    outside="culled; the valid one is unchanged",
)
@pytest.mark.parametrize("name", ["means", "quats", "scales", "opacities", "colors"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_one_broken_gaussian_leaves_the_others_unchanged(gaussian, compare, measured, name, value):
    values = gaussian()
    broken = values[name].clone()
    broken[..., 0] = value
    pair = {
        key: torch.cat([tensor, tensor]) for key, tensor in values.items() if key not in ("viewmats", "Ks")
    }
    pair[name] = torch.cat([broken, values[name]])
    both, alone = compare(values | pair), compare(values)
    for each in (both.found, both.truth):
        assert not each.meta["radii"][0, 0].any()
        assert not any(each.gradients[key][0].any() for key in pair)
        measured(float((each.image - alone.truth.image).abs().max()))
