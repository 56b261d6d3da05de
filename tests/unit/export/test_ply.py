"""The exported .ply file, read back by a library that knows the format."""

import numpy as np
import pytest
import torch
import trimesh

from egosplat.export.gaussians import geometry_columns, point_columns, write_ply
from egosplat.gaussians.model import Gaussians


@pytest.fixture
def gaussians() -> Gaussians:
    values = torch.Generator().manual_seed(0)
    shapes = {
        "means": (5, 3),
        "quats": (5, 4),
        "log_scales": (5, 3),
        "logit_opacities": (5,),
        "sh": (5, 4, 3),
        "features": (5, 0),
    }
    return Gaussians(**{name: torch.randn(shape, generator=values) for name, shape in shapes.items()})


def read(path) -> np.ndarray:
    """The vertices as they are stored."""
    scene = trimesh.load(path)
    return scene.metadata["_ply_raw"]["vertex"]["data"]


def test_ply_uses_the_names_that_viewers_expect(tmp_path, gaussians):
    write_ply(tmp_path / "x.ply", geometry_columns(gaussians), "real")
    found = read(tmp_path / "x.ply")
    for axis, name in enumerate("xyz"):
        assert np.array_equal(found[name].ravel(), gaussians.means[:, axis].numpy())
    assert np.array_equal(found["f_dc_1"].ravel(), gaussians.sh[:, 0, 1].numpy())
    # Coefficients 1 to 3 of red, then those of green, then those of blue.
    for number in range(9):
        channel, coefficient = divmod(number, 3)
        expected = gaussians.sh[:, 1 + coefficient, channel].numpy()
        assert np.array_equal(found[f"f_rest_{number}"].ravel(), expected)
    assert np.array_equal(found["opacity"].ravel(), gaussians.logit_opacities.numpy())
    assert np.array_equal(found["scale_2"].ravel(), gaussians.log_scales[:, 2].numpy())
    assert np.array_equal(found["rot_0"].ravel(), gaussians.quats[:, 0].numpy())


def test_points_have_the_colors_and_the_numbers_that_were_written(tmp_path):
    xyz, rgb = np.arange(6.0).reshape(2, 3), np.array([[0, 128, 255], [1, 2, 3]], np.uint8)
    columns = point_columns(xyz, rgb) | {"instance_whole": np.array([-1, 70_000])}
    write_ply(tmp_path / "x.ply", columns, "real")
    cloud = trimesh.load(tmp_path / "x.ply")
    np.testing.assert_array_equal(cloud.vertices, xyz)
    np.testing.assert_array_equal(cloud.colors[:, :3], rgb)
    assert read(tmp_path / "x.ply")["instance_whole"].ravel().tolist() == [-1, 70_000]
