"""Write the Gaussians of a scene: all or those of an answer, as .ply or .spz, and those on surfaces in the colors of instances."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import INSTANCES, LANGUAGE, POSES, SPLATS
from egosplat.errors import UserError
from egosplat.export.spz import write_spz
from egosplat.files import atomic_file
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.progress import log
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import GUESS
from egosplat.query.scene import instances_of_gaussians
from egosplat.report.sheets.sheet import palette

# Gaussians that are less opaque show no surface.
LEAST_OPACITY = 0.5

# By kind of a dtype, the type's name in the header and as it is stored.
_TYPES = {"f": ("float", "<f4"), "u": ("uchar", "<u1"), "i": ("int", "<i4")}


def export_gaussians(folder: Path, output: Path, members: Tensor | None, *, codes: bool) -> None:
    """Write Gaussians of a scene or variant, (M,) int64 indices or all, as .ply, perhaps with their codes, or as .spz."""
    splats = open_artifact(locate(folder, "splats")[0], SPLATS)
    gaussians = read_gaussians(splats)
    rows = torch.arange(gaussians.count) if members is None else members
    chosen = gaussians.select(rows)
    if output.suffix.lower() == ".spz":
        write_spz(output, chosen, splats.facts["sh_degree_in_use"])
    else:
        columns = geometry_columns(chosen)
        if codes:
            language = open_artifact(locate(folder, "language")[0], LANGUAGE)
            check_made_from(language, splats, axes=("gaussian",))
            code, share = (language.read(name)[rows.numpy()] for name in ("code", "share"))
            for level, name in enumerate(language.facts["levels"]):
                columns[f"share_{name}"] = share[:, level]
                columns |= {f"code_{name}_{number}": column for number, column in enumerate(code[:, level].T)}
        write_ply(output, columns, splats.origin)
    log(f"{output}: {chosen.count} Gaussians")


def answer_members(scene: Scene, phrase: str) -> Tensor:
    """Indices of the Gaussians of the answer to a query of the whole scene (UserError: there is none or several, or as ``Scene.ask``)."""
    answer, *more = scene.ask(phrase, most=1)
    if more or answer.refusal:
        why = f"it asks for {1 + len(more)} things; ask for one" if more else answer.refusal
        raise UserError(f"{scene.folder}: {phrase!r} is not exported, {why}")
    if answer.grade == GUESS:
        log(f"{phrase!r} is a best guess, with a probability of {scene.grading().shown(answer.rating)}")
    return torch.from_numpy(np.sort(answer.things[0].members))


def export_instances(folder: Path, output: Path) -> None:
    """Write a point for each Gaussian on a surface, with its instance at each level, -1 for none, and its
    color, gray for none (UserError: an artifact is missing, damaged or of other poses, or the instances are tracks)."""
    paths = locate(folder, "poses", "splats", "instances")
    poses, splats, instances = map(open_artifact, paths, (POSES, SPLATS, INSTANCES))
    for made in (splats, instances):
        check_made_from(made, poses)
    gaussians = read_gaussians(splats)
    xyz = gaussians.select(gaussians.opacities >= LEAST_OPACITY).means.numpy()
    owner, levels = instances_of_gaussians(instances, xyz), instances.facts["levels"]
    colors = np.vstack([instance_colors(instances.shape("instances/level")[0]), np.full(3, 96, np.uint8)])
    numbers = {f"instance_{level}": of_level for level, of_level in zip(levels, owner, strict=True)}
    write_ply(output, point_columns(xyz, colors[owner[-1]]) | numbers, splats.origin)
    shown = np.unique(owner[-1][owner[-1] >= 0])
    log(f"{output}: {len(xyz)} points, {len(shown)} instances of level {levels[-1]}")


def instance_colors(count: int) -> NDArray[np.uint8]:
    """(count, 3) colors of instances."""
    return (palette(count) * 255).round().astype(np.uint8)


def geometry_columns(gaussians: Gaussians) -> dict[str, NDArray[Any]]:
    """Return the properties of 3DGS (Kerbl et al. 2023) in its order: raw parameters, zero normals, SH by channel."""
    # Viewers expect all coefficients of red, then of green, then of blue.
    sh = gaussians.sh.permute(0, 2, 1).numpy()
    groups = {
        "": ("xyz", gaussians.means.numpy()),
        # Unused, but viewers of 3DGS read properties by position.
        "n": ("xyz", np.zeros((len(sh), 3), np.float32)),
        "f_dc_": (range(3), sh[:, :, 0]),
        "f_rest_": (range(3 * (sh.shape[2] - 1)), sh[:, :, 1:].reshape(len(sh), -1)),
        "opacity": ([""], gaussians.logit_opacities.numpy()[:, None]),
        "scale_": (range(3), gaussians.log_scales.numpy()),
        "rot_": (range(4), gaussians.quats.numpy()),
    }
    named = ((group, zip(names, values.T, strict=True)) for group, (names, values) in groups.items())
    return {f"{group}{name}": column for group, columns in named for name, column in columns}


def point_columns(xyz: NDArray[np.floating[Any]], rgb: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    """Return the properties of (P, 3) points and their (P, 3) colors."""
    names = ("x", "y", "z", "red", "green", "blue")
    return dict(zip(names, (*xyz.astype(np.float32).T, *rgb.T), strict=True))


def write_ply(path: Path, columns: Mapping[str, NDArray[Any]], origin: str) -> None:
    """Write a .ply file of vertices, whole or not at all: little-endian binary, with the origin of the data in its header.

    Args:
        columns: (N,) values of each property, in order: floats as float32, unsigned integers as uint8, integers as int32.
    """
    types = {name: _TYPES[values.dtype.kind] for name, values in columns.items()}
    layout = [(name, stored) for name, (_, stored) in types.items()]
    table = np.rec.fromarrays([*columns.values()], dtype=layout)
    properties = "".join(f"property {kind} {name}\n" for name, (kind, _) in types.items())
    header = f"comment egosplat, origin {origin}\nelement vertex {len(table)}\n{properties}end_header\n"
    with atomic_file(path) as scratch:
        scratch.write_bytes(
            f"ply\nformat binary_little_endian 1.0\n{header}".encode("ascii") + table.tobytes()
        )
