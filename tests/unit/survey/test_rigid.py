"""Epipolar segments against known points; corrections of poses among things that move, and where nothing can be known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, invert, make_pose, transform
from egosplat.survey.rigid import View, fit_correction, robust_scale, static_residual, static_segment, turn

CAMERA = Camera(256, 256, 90.0, 95.0, 127.0, 130.0)
NEAR = 0.5


def random_pose(seed: int, far: float = 0.2, angle: float = 15.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.normal(size=3) * angle, degrees=True).as_matrix()
    return make_pose(rotation, rng.normal(size=3) * far)


def visible_points(pose: np.ndarray, seed: int) -> np.ndarray:
    """(N, 3) in the world, in front of the camera, from the minimum depth to 20 m."""
    rng = np.random.default_rng(seed)
    depth = NEAR + rng.uniform(0, 20, 500) ** 1.5 / 5
    pixels = rng.uniform(0, 256, (500, 2))
    rays = np.concatenate([pixels, np.ones((500, 1))], axis=1) @ np.linalg.inv(CAMERA.matrix).T
    return transform(pose, rays * depth[:, None])


def project_rotated(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of points in the second camera, rotated to the orientation of the first."""
    return CAMERA.project(transform(invert(make_pose(first[:3, :3], second[:3, 3])), points))


def view(first: np.ndarray, second: np.ndarray) -> View:
    return View(CAMERA.matrix, (invert(first) @ second)[:3, 3], 2.0, NEAR)


def distance(pixels: np.ndarray, flow: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N,) from the segment, with poses taken as they are [px]."""
    return np.linalg.norm(static_residual(view(first, second), pixels, flow, np.zeros(6)), axis=1)


@pytest.mark.parametrize("seed", range(8))
def test_static_points_stay_on_their_segment(seed):
    first, second = random_pose(seed), random_pose(seed + 100)
    points = visible_points(first, seed)
    pixels = CAMERA.project(transform(invert(first), points))
    ends = project_rotated(points, first, second)
    visible = np.isfinite(ends).all(axis=1) & (np.abs(ends - pixels) < 256).all(axis=1)
    missed = distance(pixels, ends - pixels, first, second)
    assert visible.sum() > 300 and missed[visible].max() < 1e-9


def test_flow_is_compared_with_its_nearest_point_on_the_segment():
    first, second = np.eye(4), make_pose(np.eye(3), np.array([0.1, 0.0, 0.0]))
    pixel = np.array([100.0, 80.0])
    # Static points move to the left, at most by fx 0.1 / 0.5 = 18 px.
    assert static_segment(view(first, second), pixel, np.zeros(6)) == pytest.approx([-18.0, 0.0])
    flows = np.array([[-10.0, 0.0], [-10.0, 4.0], [6.0, 0.0], [-25.0, 0.0], [0.0, 0.0]])
    assert distance(pixel, flows, first, second) == pytest.approx([0.0, 4.0, 6.0, 7.0, 0.0])


@pytest.mark.parametrize("angle", [0.0, 25.0])
def test_a_pure_rotation_leaves_static_points_in_place(angle):
    first, second = np.eye(4), random_pose(3, far=0.0, angle=angle)
    flow = np.array([[0.0, 0.0], [3.0, 4.0]])
    missed = distance(np.full((2, 2), 50.0), flow, first, second)
    assert missed == pytest.approx([0.0, 5.0], abs=1e-12)


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
    turned = turn(K, ends[:, :2] / ends[:, 2:], -correction[:3])
    return pixels, turned - pixels + rng.normal(0, 0.05, (600, 2))


def scale(view: View, pixels: np.ndarray, flow: np.ndarray, correction: np.ndarray) -> float:
    return robust_scale(np.linalg.norm(static_residual(view, pixels, flow, correction), axis=1))


def test_the_correction_of_a_pose_is_found():
    """Exact poses are left alone."""
    assert np.abs(fit_correction(VIEW, *seen(VIEW, np.zeros(6)))[:3]).max() < 3e-4
    pixels, flow = seen(VIEW, TRUE)
    found = fit_correction(VIEW, pixels, flow)
    assert found[:3] == pytest.approx(TRUE[:3], abs=5e-4)
    assert scale(VIEW, pixels, flow, found) < 0.1 and scale(VIEW, pixels, flow, np.zeros(6)) > 0.5
    flow[:150] += [4.0, 9.0]  # what moves does not bend it
    assert fit_correction(VIEW, pixels, flow)[:3] == pytest.approx(TRUE[:3], abs=1e-3)


@pytest.mark.parametrize(
    ("position", "depth", "near"),
    [([0, 0, 0], 2.0, 0.5), ([0, 0, 50], 2.0, 0.5), ([1e9, 0, 0], 1e-9, 1e-12), ([1e-12, 0, 0], 1e12, 1e9)],
)
@pytest.mark.parametrize("size", [0.0, 1.0, 1e6])
def test_corrections_are_finite_and_small(position, depth, near, size):
    """No translation, a camera that passes everything, no scale; flow that a turn by 180 degrees would make."""
    view, rng = View(K, np.array(position, float), depth, near), np.random.default_rng(0)
    pixels = rng.uniform(0, 200, (50, 2))
    for flow in (np.full((50, 2), size), rng.normal(0, 1, (50, 2)) * size):
        found = fit_correction(view, pixels, flow)
        assert np.isfinite(found).all() and np.abs(found).max() <= 0.2
        assert np.isfinite(static_residual(view, pixels, flow, found)).all()


@pytest.mark.parametrize("angle", [0.2, np.pi / 2, np.pi])
def test_pixels_stay_finite_at_any_turn(angle):
    assert np.isfinite(turn(K, np.array([[0.0, 0.0], [100.0, 100.0]]), np.array([0.0, angle, 0.0]))).all()
