"""Exported .ply files, read back by a library that knows the format."""

import numpy as np
import torch
import trimesh

from egosplat.export.gaussians import geometry_columns, point_columns, write_ply
from egosplat.gaussians.model import Gaussians


def some(count: int, degree: int = 0) -> Gaussians:
    draw = torch.Generator().manual_seed(0)
    return Gaussians(
        means=torch.randn(count, 3, generator=draw) * 3,
        quats=torch.randn(count, 4, generator=draw),
        log_scales=torch.randn(count, 3, generator=draw) - 4,
        logit_opacities=torch.randn(count, generator=draw),
        sh=torch.randn(count, (degree + 1) ** 2, 3, generator=draw).clamp(-0.9, 0.9),
        features=torch.zeros(count, 0),
    )


def read(path) -> np.ndarray:
    """The vertices as they are stored."""
    return trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]


def test_ply_uses_the_names_that_viewers_expect(tmp_path):
    gaussians = some(5, 1)
    write_ply(tmp_path / "x.ply", geometry_columns(gaussians), "real")
    sh = gaussians.sh
    columns = dict(zip("xyz", gaussians.means.T, strict=True)) | {"f_dc_1": sh[:, 0, 1]}
    # Coefficients 1 to 3 of red, then those of green, then those of blue.
    columns |= {f"f_rest_{number}": sh[:, 1 + number % 3, number // 3] for number in range(9)}
    columns |= {"opacity": gaussians.logit_opacities, "scale_2": gaussians.log_scales[:, 2]}
    columns |= {"rot_0": gaussians.quats[:, 0]}
    found = read(tmp_path / "x.ply")
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name].ravel(), values, err_msg=name)


def test_points_have_the_colors_that_were_written(tmp_path):
    xyz, rgb = np.arange(6.0).reshape(2, 3), np.array([[0, 128, 255], [1, 2, 3]], np.uint8)
    write_ply(tmp_path / "x.ply", point_columns(xyz, rgb), "real")
    cloud = trimesh.load(tmp_path / "x.ply")
    np.testing.assert_array_equal(cloud.vertices, xyz)
    np.testing.assert_array_equal(cloud.colors[:, :3], rgb)
