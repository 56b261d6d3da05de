"""Initial Gaussians have 3DGS's values at finite points; random points lie in the viewing volumes."""

import numpy as np
import torch

from egosplat.gaussians.initialization import SH_C0, from_points, seen
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, make_pose

CAMERA = Camera(64, 48, 40.0, 40.0, 32.0, 24.0)


def start(xyz: np.ndarray, rgb: np.ndarray | None = None, **options: int) -> Gaussians:
    rgb = np.full(xyz.shape, 128, dtype=np.uint8) if rgb is None else rgb
    options = {"sh_degree": 2, "max_points": 1000, "seed": 0} | options
    return from_points(xyz, rgb, **options)


def poses(*centers: tuple[float, float, float]) -> np.ndarray:
    return make_pose(np.eye(3), np.array(centers))


def test_gaussians_from_points_have_the_stock_values() -> None:
    xyz = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    rgb = np.random.default_rng(1).integers(256, size=(50, 3), dtype=np.uint8)
    gaussians = start(xyz, rgb)
    np.testing.assert_allclose(gaussians.means.numpy(), xyz, rtol=1e-6)
    np.testing.assert_allclose(gaussians.sh[:, 0].numpy() * SH_C0 + 0.5, rgb / 255.0, atol=1e-6)
    assert gaussians.sh.shape == (50, 9, 3) and not gaussians.sh[:, 1:].any()
    assert gaussians.features.shape == (50, 0)
    torch.testing.assert_close(gaussians.opacities, torch.full((50,), 0.1))
    assert (gaussians.quats == torch.tensor([1.0, 0.0, 0.0, 0.0])).all()
    assert bool(gaussians.finite().all())


def test_budget_keeps_a_seeded_subset() -> None:
    xyz = np.random.default_rng(0).normal(size=(100, 3))
    one, same, other = (start(xyz, max_points=20, seed=seed) for seed in (1, 1, 2))
    assert one.count == 20
    assert torch.equal(one.means, same.means) and not torch.equal(one.means, other.means)
    rows = {tuple(row) for row in xyz.astype(np.float32).tolist()}
    assert len({tuple(row) for row in one.means.tolist()} & rows) == 20
    assert start(xyz, max_points=100).count == 100


def test_visibility_is_checked_in_all_cameras() -> None:
    points = np.array(
        [[0, 0, 2.0], [0, 0, -2.0], [0, 0, 0.05], [9.0, 0, 2.0], [5.0, 0, 2.0], [np.nan, 0, 2.0]]
    )
    one = seen(points, CAMERA, poses((0, 0, 0)), near_plane=0.1)
    two = seen(points, CAMERA, poses((0, 0, 0), (5, 0, 0)), near_plane=0.1)
    assert one.tolist() == [True, False, False, False, False, False]
    assert two.tolist() == [True, False, False, False, True, False]
    assert seen(points[:0], CAMERA, poses((0, 0, 0)), near_plane=0.1).shape == (0,)
