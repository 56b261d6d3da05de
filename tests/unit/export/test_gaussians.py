"""Exported .spz and .ply files, read back by libraries that know the formats."""

import gzip
import struct

import numpy as np
import pytest
import torch
import trimesh
from gsply.spz import read_spz

from egosplat.errors import UserError
from egosplat.export.gaussians import geometry_columns, point_columns, write_ply
from egosplat.export.spz import TURNED_SH, write_spz
from egosplat.gaussians.model import Gaussians
from egosplat.rasterize.reference.spherical_harmonics import sh_basis

TURNED = np.array([1, -1, -1])


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


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_another_reader_finds_the_gaussians(tmp_path, degree):
    """Up to the steps of the format: 2^-bits, 1/16 of a logarithm, 1/255 of an opacity, 5 or 4 bits of a coefficient."""
    gaussians = some(200, degree)
    write_spz(tmp_path / "x.spz", gaussians, degree)
    found = read_spz(tmp_path / "x.spz")
    np.testing.assert_allclose(found.means, gaussians.means.numpy() * TURNED, atol=2**-12)
    np.testing.assert_allclose(found.scales, gaussians.log_scales.numpy(), atol=1 / 16)
    opacities = torch.from_numpy(np.array(found.opacities)).sigmoid().ravel()
    np.testing.assert_allclose(opacities, gaussians.opacities, atol=1 / 255)
    np.testing.assert_allclose(found.sh0.reshape(-1, 3), gaussians.sh[:, 0], atol=0.02)
    if degree == 0:
        assert found.shN is None
        return
    rest = gaussians.sh[:, 1:].numpy()
    signs = TURNED_SH[: rest.shape[1], None]
    np.testing.assert_allclose(np.reshape(found.shN, rest.shape), rest * signs, atol=0.07)


@pytest.mark.parametrize("unit", [1e-3, 1e6])
def test_sizes_that_the_format_cannot_hold_are_an_error(tmp_path, unit):
    gaussians = some(50)
    gaussians.means.mul_(unit)
    gaussians.log_scales.add_(np.log(unit))
    with pytest.raises(UserError, match="x.spz.*poses.meters_per_unit"):
        write_spz(tmp_path / "x.spz", gaussians, 0)
    assert not any(tmp_path.iterdir())


def test_signs_of_spherical_harmonics_are_those_of_the_turned_direction():
    directions = torch.nn.functional.normalize(torch.randn(20, 3, generator=torch.Generator().manual_seed(0)))
    before, after = (sh_basis(3, one)[:, 1:] for one in (directions, directions * torch.from_numpy(TURNED)))
    torch.testing.assert_close(after, before * torch.from_numpy(TURNED_SH), check_dtype=False)


def test_a_gaussian_beyond_the_range_is_left_out_and_the_header_tells_no_antialiasing(tmp_path):
    gaussians = some(200, 1)
    gaussians.means[7] = 1e9
    write_spz(tmp_path / "x.spz", gaussians, 1)
    assert len(read_spz(tmp_path / "x.spz").means) == 199
    header = struct.unpack("<4sIIBBBB", gzip.decompress((tmp_path / "x.spz").read_bytes())[:16])
    assert header[:4] == (b"NGSP", 3, 199, 1) and header[5] == 0
    with pytest.raises(UserError, match="too far away"):
        write_spz(tmp_path / "x.spz", gaussians.select(torch.tensor([7])), 1)


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


def test_points_have_the_colors_and_the_numbers_that_were_written(tmp_path):
    xyz, rgb = np.arange(6.0).reshape(2, 3), np.array([[0, 128, 255], [1, 2, 3]], np.uint8)
    columns = point_columns(xyz, rgb) | {"instance_whole": np.array([-1, 70_000])}
    write_ply(tmp_path / "x.ply", columns, "real")
    cloud = trimesh.load(tmp_path / "x.ply")
    np.testing.assert_array_equal(cloud.vertices, xyz)
    np.testing.assert_array_equal(cloud.colors[:, :3], rgb)
    assert read(tmp_path / "x.ply")["instance_whole"].ravel().tolist() == [-1, 70_000]
