"""The correction of a pose: it is found among things that move, and stays finite where nothing can be known."""

import numpy as np
import pytest

from egosplat.geometry import Camera
from egosplat.survey.rigid import View, fit_correction, robust_scale, static_residual, turn

K = Camera(200, 200, 150.0, 150.0, 100.0, 100.0).matrix
VIEW = View(K, np.array([0.2, 0.0, 0.05]), 2.0, 0.5)
TRUE = np.array([0.01, -0.006, 0.004, 0.0, 0.02, -0.01])


def seen(view: View, correction: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and flow of 600 static points where the given pose is off by a correction."""
    rng = np.random.default_rng(seed)
    pixels, depth = rng.uniform(0, 200, (600, 2)), rng.uniform(1, 4, (600, 1))
    position = view.position + view.depth * correction[3:]
    rays = np.concatenate([pixels, np.ones((600, 1))], axis=1) @ np.linalg.inv(K).T * depth - position
    ends = rays @ K.T
    return pixels, turn(K, ends[:, :2] / ends[:, 2:], -correction[:3]) - pixels + rng.normal(
        0, 0.05, (600, 2)
    )


def scale(view: View, pixels: np.ndarray, flow: np.ndarray, correction: np.ndarray) -> float:
    return robust_scale(np.linalg.norm(static_residual(view, pixels, flow, correction), axis=1))


def test_the_correction_of_a_pose_is_found():
    pixels, flow = seen(VIEW, TRUE)
    found = fit_correction(VIEW, pixels, flow)
    assert found[:3] == pytest.approx(TRUE[:3], abs=5e-4)
    assert scale(VIEW, pixels, flow, found) < 0.1 and scale(VIEW, pixels, flow, np.zeros(6)) > 0.5


def test_what_moves_does_not_bend_the_correction():
    pixels, flow = seen(VIEW, TRUE)
    flow[:150] += [4.0, 9.0]
    assert fit_correction(VIEW, pixels, flow)[:3] == pytest.approx(TRUE[:3], abs=1e-3)


def test_exact_poses_are_left_alone():
    assert np.abs(fit_correction(VIEW, *seen(VIEW, np.zeros(6)))[:3]).max() < 3e-4


@pytest.mark.parametrize(
    "view",
    [
        View(K, np.zeros(3), 2.0, 0.5),
        View(K, np.array([0.0, 0.0, 50.0]), 2.0, 0.5),
        View(K, np.array([1e9, 0.0, 0.0]), 1e-9, 1e-12),
        View(K, np.array([1e-12, 0.0, 0.0]), 1e12, 1e9),
    ],
)
@pytest.mark.parametrize("size", [0.0, 1.0, 1e6])
def test_corrections_are_finite_and_small(view, size):
    """No translation, a camera that passes everything, no scale; flow that a turn by 180 degrees would make."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 200, (50, 2))
    for flow in (np.full((50, 2), size), rng.normal(0, 1, (50, 2)) * size):
        found = fit_correction(view, pixels, flow)
        assert np.isfinite(found).all() and np.abs(found).max() <= 0.2
        assert np.isfinite(static_residual(view, pixels, flow, found)).all()


def test_without_pixels_nothing_is_corrected():
    nothing = np.zeros((0, 2))
    assert (fit_correction(VIEW, nothing, nothing) == 0).all() and robust_scale(np.zeros(0)) > 0


@pytest.mark.parametrize("angle", [0.2, np.pi / 2, np.pi])
def test_pixels_stay_finite_at_any_turn(angle):
    assert np.isfinite(turn(K, np.array([[0.0, 0.0], [100.0, 100.0]]), np.array([0.0, angle, 0.0]))).all()
