"""Write .ply files: Gaussians for public 3DGS viewers, and point clouds."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.files import atomic_file
from egosplat.gaussians.model import Gaussians

Columns = dict[str, NDArray[Any]]

_TYPES = {"f": "float", "u": "uchar", "i": "int"}
_STORED = {"f": "<f4", "u": "<u1", "i": "<i4"}


def geometry_columns(gaussians: Gaussians) -> Columns:
    """Return the properties of 3DGS (Kerbl et al. 2023) in its order: raw parameters, zero normals, SH by channel."""
    # Viewers expect all coefficients of red, then of green, then of blue.
    sh = gaussians.sh.permute(0, 2, 1).numpy()
    rest = sh[:, :, 1:].reshape(len(sh), -1)
    nothing = np.zeros(len(sh), np.float32)
    return {
        **dict(zip("xyz", gaussians.means.numpy().T, strict=True)),
        # Unused, but viewers of 3DGS read properties by position.
        **dict.fromkeys(("nx", "ny", "nz"), nothing),
        **{f"f_dc_{channel}": sh[:, channel, 0] for channel in range(3)},
        **{f"f_rest_{number}": rest[:, number] for number in range(rest.shape[1])},
        "opacity": gaussians.logit_opacities.numpy(),
        **{f"scale_{axis}": gaussians.log_scales[:, axis].numpy() for axis in range(3)},
        **{f"rot_{number}": gaussians.quats[:, number].numpy() for number in range(4)},
    }


def code_columns(code: NDArray[np.float32], share: NDArray[np.float32], levels: Sequence[str]) -> Columns:
    """Return ``share_whole``, ``code_whole_0``, ... of (N, L, C) codes and (N, L) shares."""
    columns: Columns = {}
    for level, name in enumerate(levels):
        columns[f"share_{name}"] = share[:, level]
        columns |= {f"code_{name}_{number}": code[:, level, number] for number in range(code.shape[2])}
    return columns


def point_columns(xyz: NDArray[np.floating[Any]], rgb: NDArray[np.uint8]) -> Columns:
    """Return the properties of (P, 3) points and their (P, 3) colors."""
    places = zip("xyz", xyz.astype(np.float32).T, strict=True)
    return {**dict(places), **dict(zip(("red", "green", "blue"), rgb.T, strict=True))}


def ply_bytes(columns: Mapping[str, NDArray[Any]], origin: str) -> bytes:
    """A .ply file of vertices, little-endian binary, with the origin of the data in its header.

    Args:
        columns: (N,) values of each property, in order: floats as float32, unsigned integers as uint8, integers as int32.
    """
    table = np.empty(
        len(next(iter(columns.values()))),
        [(name, _STORED[values.dtype.kind]) for name, values in columns.items()],
    )
    for name, values in columns.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment egosplat, origin {origin}",
        f"element vertex {len(table)}",
        *(f"property {_TYPES[values.dtype.kind]} {name}" for name, values in columns.items()),
        "end_header",
    ]
    return "\n".join([*header, ""]).encode("ascii") + table.tobytes()


def write_ply(path: Path, columns: Mapping[str, NDArray[Any]], origin: str) -> None:
    """Write a .ply file; it is complete or absent. Arguments as in ``ply_bytes``."""
    with atomic_file(path) as scratch:
        scratch.write_bytes(ply_bytes(columns, origin))
