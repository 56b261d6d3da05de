"""Write the Gaussians of a scene, all or those of an answer, as .ply."""

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
from egosplat.artifacts.schemas import LANGUAGE, SPLATS
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.progress import log
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import GUESS

# By kind of a dtype, the type's name in the header and as it is stored.
_TYPES = {"f": ("float", "<f4"), "u": ("uchar", "<u1")}


def export_gaussians(folder: Path, output: Path, members: Tensor | None, *, codes: bool) -> None:
    """Write Gaussians of a scene or variant, (M,) int64 indices or all, as .ply, perhaps with their codes."""
    splats = open_artifact(locate(folder, "splats")[0], SPLATS)
    gaussians = read_gaussians(splats)
    rows = torch.arange(gaussians.count) if members is None else members
    chosen = gaussians.select(rows)
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
    """Indices of the Gaussians of the best answer to a query of the whole scene (UserError: there is none, or as ``Scene.ask``)."""
    answer = scene.ask(phrase, most=1)[0]
    if answer.refusal:
        raise UserError(f"{scene.folder}: {phrase!r} is not exported, {answer.refusal}")
    if answer.grade == GUESS:
        log(f"{phrase!r} is a best guess, with a probability of {scene.grading().shown(answer.rating)}")
    return torch.from_numpy(np.sort(answer.things[0].members))


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
        columns: (N,) values of each property, in order: floats as float32, unsigned integers as uint8.
    """
    types = {name: _TYPES[values.dtype.kind] for name, values in columns.items()}
    table = np.rec.fromarrays(
        [*columns.values()], dtype=[(name, stored) for name, (_, stored) in types.items()]
    )
    properties = "".join(f"property {kind} {name}\n" for name, (kind, _) in types.items())
    header = f"comment egosplat, origin {origin}\nelement vertex {len(table)}\n{properties}end_header\n"
    with atomic_file(path) as scratch:
        scratch.write_bytes(
            f"ply\nformat binary_little_endian 1.0\n{header}".encode("ascii") + table.tobytes()
        )
