"""Read Gaussians that another program trained: .ply of 3DGS, compressed .ply of SuperSplat, .spz."""

import gzip
import math
import struct
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.calibration.ply import read_vertices
from egosplat.errors import UserError, from_extra, reraise_as
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.similarity import moved
from egosplat.progress import log

_MAGIC, _GZIP = b"NGSP", b"\x1f\x8b"
_SPZ_VERSIONS = (2, 3, 4)

# What a header of SuperSplat's compressed format names.
_PACKED = b"packed_position"

# Number of f_rest columns: three colors of the coefficients above degree 0, for degrees 0 to 3.
_RESTS = {0: 0, 9: 1, 24: 2, 45: 3}

# So many Gaussians never are all alike.
_MANY = 50

# Logit that stands for an opacity of 1 or 0, which some programs write as infinite, and the largest that training leaves;
# largest coefficient of a color.
_OPAQUE, _LARGEST, _BRIGHTEST = 15.0, 20.0, 1e4

_SPZ_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


def read_source(path: Path) -> Gaussians:
    """Read the Gaussians of a file, in its world, without those that have a number that is not finite
    (UserError: the file is damaged, or holds something else than 3D Gaussians of spherical harmonics up to
    degree 3)."""
    with path.open("rb") as file:
        head = file.read(65536)
    if head.startswith(b"ply"):
        found = (
            _read_by_gsply(path, "plyread")
            if _PACKED in head.partition(b"end_header")[0]
            else _read_ply(path)
        )
    elif head.startswith((_GZIP, _MAGIC)):
        found = _read_spz(path, head)
    else:
        raise UserError(
            f"{path}: neither a .ply nor an .spz file. Export .ply; SuperSplat reads .splat, .ksplat and .sog, and writes it"
        )
    return _usable(found, path)


def _read_ply(path: Path) -> Gaussians:
    table = read_vertices(path)
    degree = _check_columns(table.dtype.names or (), path)
    count = (degree + 1) ** 2 - 1

    def columns(*names: str) -> NDArray[np.float32]:
        # A double beyond float32 becomes infinite and is left out.
        with np.errstate(over="ignore"):
            return np.stack([table[name] for name in names], axis=-1).astype(np.float32)

    # All coefficients of red, then of green, then of blue.
    rest = columns(*_numbered("f_rest", 3 * count)).reshape(-1, 3, count) if count else None
    first = columns(*_numbered("f_dc", 3))[:, None]
    return _gaussians(
        columns(*"xyz"),
        columns(*_numbered("rot", 4)),
        columns(*_numbered("scale", 3)),
        columns("opacity")[:, 0],
        first if rest is None else np.concatenate([first, rest.transpose(0, 2, 1)], axis=1),
    )


def _check_columns(names: tuple[str, ...], path: Path) -> int:
    """The degree of spherical harmonics of a file with these columns; UserError if they are not of 3D Gaussians."""
    has, rests = {*names}, sum(name.startswith("f_rest_") for name in names)
    if lacking := [name for name in (*_numbered("scale", 2), "opacity") if name not in has]:
        what = (
            f"has no {lacking[0]}: a mesh or a point cloud, not Gaussians. Give the file that training wrote"
        )
    elif "scale_2" not in has:
        what = "has two scales: the flat Gaussians of 2DGS. Train 3D Gaussians on the same pictures"
    elif "filter_3D" in has:
        what = "has filter_3D of Mip-Splatting. Give the file that its create_fused_ply.py writes"
    elif "f_dc_0" not in has:
        what = "has no f_dc_0. Export with --ply-color-mode sh_coeffs of ns-export, or from SuperSplat"
    elif rests not in _RESTS:
        what = f"has {rests} columns f_rest_, no spherical harmonics of degree 0 to 3. Export up to degree 3"
    else:
        needed = (*"xyz", *_numbered("rot", 4), *_numbered("f_dc", 3), *_numbered("f_rest", rests))
        if not (lacking := [name for name in needed if name not in has]):
            return _RESTS[rests]
        what = f"has no {lacking[0]}. Export it again, with all properties"
    raise UserError(f"{path}: {what}")


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{number}" for number in range(count))


def _read_spz(path: Path, head: bytes) -> Gaussians:
    with reraise_as(partial(_damaged, path)):
        if head.startswith(_GZIP):
            with gzip.open(path) as file:
                head = file.read(8)
        magic, version = head[:4], struct.unpack("<I", head[4:8])[0]
    if magic != _MAGIC or version not in _SPZ_VERSIONS:
        what = f"is .spz of version {version}" if magic == _MAGIC else "is packed by gzip, and no .spz"
        raise UserError(f"{path}: {what}; versions 2 to 4 are read. Export a .ply")
    # The axes are those of OpenGL, where a .ply file of the same training has those of COLMAP.
    return moved(_read_by_gsply(path, "read_spz"), _SPZ_AXES)


def _read_by_gsply(path: Path, function: str) -> Gaussians:
    with from_extra("gsply", str(path)):
        import gsply
    # Decompressors have errors of their own, which a damaged file raises, too.
    with reraise_as(partial(_damaged, path)):
        data = getattr(gsply, function)(path)
    rest = [] if data.shN is None else [data.shN]
    sh = np.concatenate([data.sh0[:, None], *rest], axis=1)
    return _gaussians(data.means, data.quats, data.scales, data.opacities, sh)


def _damaged(path: Path, error: Exception) -> UserError:
    return UserError(
        f"{path}: not a readable packed file ({str(error)[:100]}). Export it again, or an uncompressed .ply"
    )


def _gaussians(*arrays: NDArray[np.floating[Any]]) -> Gaussians:
    """Gaussians of centers, quaternions, log scales, logit opacities and spherical harmonics."""
    parts = [torch.from_numpy(np.ascontiguousarray(array, np.float32)) for array in arrays]
    return Gaussians(*parts, features=torch.zeros(len(parts[0]), 0))


def _usable(gaussians: Gaussians, path: Path) -> Gaussians:
    if not gaussians.count:
        raise UserError(f"{path}: holds no Gaussian. Export it again")
    logits = gaussians.logit_opacities.nan_to_num(float("nan"), _OPAQUE, -_OPAQUE)
    gaussians = replace(gaussians, logit_opacities=logits)
    turned, small = gaussians.quats.norm(dim=1) > 0, gaussians.scales.isfinite().all(dim=1)
    dim = gaussians.sh.abs().amax(dim=(1, 2)) <= _BRIGHTEST
    whole = gaussians.finite() & turned & dim
    if lost := int((~whole).sum()):
        why = f"{(~turned).sum()} with rot of length 0, {(~small).sum()} with scales over e^88, "
        why += f"{(~dim).sum()} with colors over {_BRIGHTEST:g}, or not finite"
        if lost == gaussians.count:
            raise UserError(f"{path}: none of {lost} Gaussians can be drawn: {why}. Export it again")
        log(f"{path}: leaves out {lost} of {gaussians.count} Gaussians: {why}")
    _check_activations(gaussians := gaussians.select(whole), path)
    return gaussians


def _check_activations(gaussians: Gaussians, path: Path) -> None:
    """Raise UserError for opacities that are no logits, or scales that are no logarithms, as no training leaves them."""
    logits, center = gaussians.logit_opacities, gaussians.means.median(dim=0).values
    # In a scene of millimeters each may be longer than 1, but not than a hundredth of the scene.
    least, away = float(gaussians.log_scales.min()), float((gaussians.means - center).abs().median())
    # Percent and bytes are above what training leaves, too.
    shares = logits.min() >= 0 and not 1 < logits.max() <= _LARGEST
    lengths = least > 0 and math.exp(least) > 1e-2 * away
    # Of few, as of a part that was cut out, all may be faint, or large.
    if gaussians.count >= _MANY and (shares or lengths):
        what = (
            "opacity, never below 0, has no logits" if shares else "scale_0 to 2, above 0, have no logarithms"
        )
        raise UserError(f"{path}: {what}. Export the parameters as training has them")
