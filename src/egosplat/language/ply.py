"""Export Gaussians to a .ply file for public 3DGS viewers, with codes as additional properties."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.output_files import check_output, output_file, text_kind
from egosplat.progress import log

Columns = dict[str, NDArray[np.float32]]

EXPORT = text_kind("egosplat export", ".ply", begin="ply\n", mark="\ncomment egosplat, origin ")


def export(scene: Path, output: Path, codes: bool) -> None:
    """Write the Gaussians of a scene folder to a .ply file.

    Args:
        scene: folder with splats.zarr, and with language.zarr if ``codes``.
        codes: also write codes and shares.

    Raises:
        UserError: an artifact is missing, damaged or made from other splats, or ``output`` exists and is no export.
    """
    check_output(output, EXPORT)
    splats = open_artifact(scene / "splats.zarr", SPLATS)
    columns = geometry_columns(read_gaussians(splats))
    if codes:
        language = open_artifact(scene / "language.zarr", LANGUAGE)
        check_made_from(language, splats, axes=("gaussian",))
        columns |= code_columns(language.read("code"), language.read("share"), language.facts["levels"])
    write_ply(output, columns, splats.origin)
    log(f"{output}: {len(columns['x'])} Gaussians, {len(columns)} properties each")


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


def write_ply(path: Path, columns: Columns, origin: str) -> None:
    """Write float32 vertex properties, little-endian binary; the file is complete or absent.

    Args:
        columns: (N,) values of each property, in order.
        origin: ``real`` or ``synthetic`` data, for the header.

    Raises:
        UserError: ``path`` exists and was not written by ``export``.
    """
    vertices = np.stack(list(columns.values()), axis=1).astype("<f4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment egosplat, origin {origin}",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in columns),
        "end_header",
    ]
    with output_file(path, EXPORT) as scratch, scratch.open("wb") as file:
        file.write("\n".join([*header, ""]).encode("ascii"))
        file.write(vertices.tobytes())
