"""Spherical harmonics equal SciPy's, whose signs include the Condon-Shortley phase."""

import math

import pytest
import torch
from scipy.special import sph_harm_y

from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics

TOLERANCE = {torch.float32: 2e-6, torch.float64: 1e-12}


def directions(count: int, dtype: torch.dtype) -> torch.Tensor:
    return torch.randn(count, 3, dtype=dtype, generator=torch.Generator().manual_seed(0))


def real_harmonic(degree: int, order: int, direction: torch.Tensor) -> float:
    x, y, z = (direction / direction.norm()).tolist()
    value = sph_harm_y(degree, abs(order), math.acos(z), math.atan2(y, x))
    if order == 0:
        return float(value.real)
    return math.sqrt(2) * float(value.real if order > 0 else value.imag)


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize(("degree", "order"), [(d, m) for d in range(4) for m in range(-d, d + 1)])
def test_each_function_equals_scipy_s(degree, order, dtype):
    dirs = directions(20, dtype)
    coeffs = torch.zeros(20, 16, 3, dtype=dtype)
    coeffs[:, degree * degree + degree + order, 1] = 1.0
    found = spherical_harmonics(3, dirs, coeffs)
    expected = torch.tensor([real_harmonic(degree, order, each.double()) for each in dirs], dtype=dtype)
    torch.testing.assert_close(found[:, 1], expected, atol=TOLERANCE[dtype], rtol=0)
    assert (found[:, [0, 2]] == 0).all()


@pytest.mark.parametrize("degree", range(4))
def test_coefficients_beyond_the_degree_are_ignored(degree):
    dirs, count = directions(5, torch.float64), (degree + 1) ** 2
    coeffs = torch.randn(5, 16, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    unread = coeffs.clone()
    unread[:, count:] = torch.nan
    low = spherical_harmonics(degree, dirs, unread)
    torch.testing.assert_close(low, spherical_harmonics(degree, dirs, coeffs[:, :count]))
    coeffs[:, count:] = 0.0
    torch.testing.assert_close(low, spherical_harmonics(3, dirs, coeffs))


def test_length_of_directions_does_not_matter_and_gradients_are_right_also_without_direction():
    dirs = directions(4, torch.float64).requires_grad_()
    coeffs = torch.randn(4, 16, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    torch.testing.assert_close(spherical_harmonics(3, dirs, coeffs), spherical_harmonics(3, dirs * 7, coeffs))
    assert torch.autograd.gradcheck(
        lambda d, c: spherical_harmonics(3, d, c), (dirs, coeffs.requires_grad_())
    )
    none = torch.zeros(1, 3, requires_grad=True)
    spherical_harmonics(3, none, torch.ones(1, 16, 3)).sum().backward()
    assert none.grad.isfinite().all()
