"""Projection of Gaussians against independent formulas, and culling."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, invert, make_pose, transform
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference.projection import Projected, project

CAMERA = Camera(64, 48, 60.0, 55.0, 30.5, 25.0)
EPS2D = 0.3


def project_numpy(means, quats, scales, opacities, camera_to_world=None, **options) -> Projected:
    """``project`` in float64, with the near plane at 0.1 and the camera above."""
    world_to_camera = np.eye(4) if camera_to_world is None else invert(camera_to_world)
    options = {"near_plane": 0.1, "far_plane": 100.0} | options
    values = means, quats, scales, opacities, means, [world_to_camera], [CAMERA.matrix]
    tensors = [torch.as_tensor(np.asarray(each, dtype=np.float64)) for each in values]
    return project(Arguments(*tensors, CAMERA.width, CAMERA.height, eps2d=EPS2D, **options), 0)


def one(mean=(0.0, 0.0, 2.0), quat=(1.0, 0.0, 0.0, 0.0), scale=(0.1, 0.1, 0.1), opacity=0.5, **options):
    return project_numpy([mean], [quat], [scale], [opacity], **options)


def random_scene(count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    pose = make_pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    means = transform(pose, rng.uniform([-0.8, -0.6, 1.5], [0.8, 0.6, 4.0], (count, 3)))
    quats, scales = rng.normal(size=(count, 4)), rng.uniform(0.02, 0.2, (count, 3))
    return means, quats, scales, rng.uniform(0.1, 0.9, count), pose


def test_centers_and_depths_equal_those_of_the_camera():
    means, quats, scales, opacities, pose = random_scene(30)
    found = project_numpy(means, quats, scales, opacities, pose)
    in_camera = transform(invert(pose), means)
    np.testing.assert_allclose(found.means2d.numpy(), CAMERA.project(in_camera), atol=1e-9)
    np.testing.assert_allclose(found.depths.numpy(), in_camera[:, 2], atol=1e-12)
    assert (found.radii > 0).all()


def test_conics_equal_those_of_the_linearised_camera():
    means, quats, scales, opacities, pose = random_scene(30)
    found = project_numpy(means, quats, scales, opacities, pose)
    rotations = Rotation.from_quat(quats, scalar_first=True).as_matrix()
    step = 1e-5 * np.eye(3)
    for mean, rotation, scale, opacity, conic, radii in zip(
        means, rotations, scales, opacities, found.conics.numpy(), found.radii.numpy(), strict=True
    ):
        # The Jacobian of world to pixels by finite differences of Camera.project.
        pixels = CAMERA.project(transform(invert(pose), np.concatenate([mean + step, mean - step])))
        jacobian = (pixels[:3] - pixels[3:]).T / 2e-5
        covariance = jacobian @ rotation @ np.diag(scale**2) @ rotation.T @ jacobian.T + EPS2D * np.eye(2)
        inverse = np.linalg.inv(covariance)
        np.testing.assert_allclose(conic, inverse[[0, 0, 1], [0, 1, 1]], rtol=1e-5, atol=1e-9)
        extent = math.sqrt(2 * math.log(255 * opacity)) * np.sqrt(np.diag(covariance))
        np.testing.assert_array_equal(radii, np.ceil(extent))


def test_linearisation_is_clamped_to_the_wider_frustum():
    # The center's slope is 1; the covariance is that at slope (W - cx) / fx + 0.3 W / (2 fx) = 0.72.
    found = one(mean=(2.0, 0.0, 2.0), scale=(0.1, 0.1, 1.0))
    slope = (CAMERA.width - CAMERA.cx) / CAMERA.fx + 0.15 * CAMERA.width / CAMERA.fx
    variance = (CAMERA.fx / 2 * 0.1) ** 2 + (CAMERA.fx * slope / 2) ** 2 + EPS2D
    assert 1 / found.conics[0, 0].item() == pytest.approx(variance, rel=1e-12)
    assert found.means2d[0, 0].item() == pytest.approx(CAMERA.fx + CAMERA.cx)


def test_antialiased_opacity_keeps_the_energy():
    variance = (60.0 * 0.01 / 2) ** 2, (55.0 * 0.01 / 2) ** 2
    expected = 0.5 * math.sqrt(math.prod(variance) / math.prod(each + EPS2D for each in variance))
    found = one(scale=(0.01,) * 3, rasterize_mode="antialiased").opacities.item()
    assert found == pytest.approx(expected, rel=1e-12)
    assert one(scale=(0.01,) * 3).opacities.item() == 0.5


def test_needles_keep_their_thickness_in_float32():
    # 3000 px long and 0 px thick before the blur: the conic's larger eigenvalue is 1 / eps2d.
    halves = torch.linspace(0.1, 0.7, 9)
    quats = torch.stack([halves.cos(), 0 * halves, 0 * halves, halves.sin()], dim=-1)
    means, scales = (
        torch.tensor([[0.0, 0.0, 1.0]]).repeat(9, 1),
        torch.tensor([[50.0, 0.0, 0.0]]).repeat(9, 1),
    )
    K = torch.tensor([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])
    camera = torch.eye(4)[None], K[None], 64, 48
    gaussians = means, quats, scales, torch.full((9,), 0.5), means
    found = project(Arguments(*gaussians, *camera, far_plane=9.0, eps2d=EPS2D), 0)
    a, b, c = found.conics.double().T
    largest = ((a - c) ** 2 + 4 * b * b).sqrt() / 2 + (a + c) / 2
    torch.testing.assert_close(largest, torch.full_like(largest, 1 / EPS2D), rtol=1e-5, atol=0)


@pytest.mark.parametrize(
    "culled",
    [
        *(
            {"mean": mean}
            for mean in [(0, 0, -2), (0, 0, 0), (0, 0, 0.0999), (0, 0, 100.1), (20, 0, 2), (0, -20, 2)]
        ),
        *({"opacity": opacity} for opacity in (1 / 255.1, math.nan, math.inf)),
        *({"quat": quat} for quat in [(0, 0, 0, 0), (math.nan, 0, 0, 0), (math.inf, 0, 0, 0)]),
        *({"scale": scale} for scale in [(math.inf, 0.1, 0.1), (1e200, 1e200, 0.1)]),
        {"opacity": 0.02, "scale": (1e-4,) * 3, "rasterize_mode": "antialiased"},
        {"radius_clip": 13.0},
        {"mean": (math.nan, 0.0, 2.0)},
        {"mean": (0.0, 0.0, math.inf), "far_plane": math.inf},
    ],
    ids=str,
)
def test_gaussians_outside_the_view_are_culled(culled):
    found = one(**culled)
    assert (found.radii == 0).all()
    for values in (found.means2d, found.conics, found.depths, found.opacities):
        assert (values == 0).all()


@pytest.mark.parametrize(
    "kept",
    [
        *({"mean": mean} for mean in [(0.0, 0.0, 0.1001), (0.0, 0.0, 99.9), (1.3, 0.0, 2.0)]),
        *({"opacity": 1 / 254.9}, {"opacity": 0.02, "scale": (1e-4,) * 3}, {"radius_clip": 8.0}),
        *(
            {"radius_clip": 3.0, "scale": (0.1, 0.01, 0.01)},
            {"quat": (1e-9, 0.0, 0.0, 0.0)},
            {"scale": (0.0,) * 3},
        ),
    ],
    ids=str,
)
def test_gaussians_inside_the_view_are_kept(kept):
    assert (one(**kept).radii > 0).all()
