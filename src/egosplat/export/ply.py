"""Write .ply files: Gaussians for public 3DGS viewers, and points in the colors of their instances."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.lineage import locate, open_histories
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, SPLATS, seconds_of
from egosplat.files import atomic_file
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.histories.known import Rests
from egosplat.progress import log
from egosplat.query.scene import instances_of_gaussians
from egosplat.report.sheets.sheet import palette

Columns = dict[str, NDArray[Any]]

# Color of points without an instance.
_GREY = 96

# Gaussians that are less opaque show no surface.
LEAST_OPACITY = 0.5

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


def write_instances(scene: Path, output: Path) -> None:
    """Write a point for each Gaussian on a surface, with its instance at each level, -1 for none, and its color.

    Where histories.zarr is there, its things are points, too, and every point has a thing, -1 for what stays, and a span of time.

    Raises:
        UserError: an artifact is missing or damaged, or the instances are tracks.
    """
    splats, instances = map(open_artifact, locate(scene, "splats", "instances"), (SPLATS, INSTANCES))
    gaussians = read_gaussians(splats)
    xyz = gaussians.select(gaussians.opacities >= LEAST_OPACITY).means.numpy()
    owner = instances_of_gaussians(instances, xyz)
    levels, coarsest = instances.facts["levels"], owner[-1]
    colors = instance_colors(instances.shape("instances/level")[0])
    rgb = np.where((coarsest >= 0)[:, None], colors[coarsest], np.uint8(_GREY))
    columns = point_columns(xyz, rgb)
    columns |= {f"instance_{level}": owner[index] for index, level in enumerate(levels)}
    told = f"{len(np.unique(coarsest[coarsest >= 0]))} instances of level {levels[-1]}"
    if (made := open_histories(scene, splats)) is not None:
        seconds = seconds_of(open_artifact(locate(scene, "frames")[0], FRAMES))
        rests = Rests.read(made, seconds, gaussians.means.device)
        columns = _with_rests(columns, rests, float(seconds[-1]))
        told += f", {len(rests.thing)} rests"
    write_ply(output, columns, splats.origin)
    log(f"{output}: {len(columns['x'])} points, {told}")


def instance_colors(count: int) -> NDArray[np.uint8]:
    """(count, 3) colors of instances."""
    return (palette(count) * 255).round().astype(np.uint8)


def _with_rests(columns: Columns, rests: Rests, last_s: float) -> Columns:
    """Append the points of rests to those of what stays, which lasts until the last second."""
    shown = (rests.gaussians.opacities >= LEAST_OPACITY).numpy()
    rest, count = rests.rest[shown], len(columns["x"])
    thing = rests.thing[rest].astype(np.int32)
    stays = {
        "thing": np.full(count, -1, np.int32),
        "from_s": np.zeros(count),
        "until_s": np.full(count, last_s),
    }
    lying = {"thing": thing, "from_s": rests.from_s[rest], "until_s": rests.until_s[rest]}
    colors = instance_colors(len(rests.feature))[thing]
    lying |= point_columns(rests.gaussians.means.numpy()[shown], colors)
    nothing = np.full(len(rest), -1, np.int32)
    return {
        name: np.concatenate([values, lying.get(name, nothing)]) for name, values in (columns | stays).items()
    }
