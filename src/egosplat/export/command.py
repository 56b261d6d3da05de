"""Write a finished scene for other programs: ``egosplat export``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.errors import UserError
from egosplat.export.dataset import export_dataset, write_colmap, write_nerfstudio
from egosplat.export.instance_cloud import export_instances
from egosplat.export.ply import PLY, code_columns, geometry_columns, write_ply
from egosplat.export.spz import SPZ, write_spz
from egosplat.gaussians.io import read_gaussians
from egosplat.output_files import check_output
from egosplat.progress import log
from egosplat.query.command import open_question, open_sources
from egosplat.query.options import QueryOptions
from egosplat.query.scene_query import ask_scene, index_scene

# The files of each format; the others are folders.
_FILES = {"ply": PLY, "spz": SPZ, "instances": PLY}

_CAMERAS = {"nerfstudio": write_nerfstudio, "colmap": write_colmap}

_OF_QUERIES = ("ply", "spz")


@dataclass(frozen=True)
class Exporting:
    """What to write.

    Attributes:
        format: ply or spz, Gaussians; instances, a point cloud; nerfstudio or colmap, images with cameras.
        output: file or folder; None for a name in the scene's folder.
        query: words; only the Gaussians of the best answer are written. None writes all.
        codes: also write the codes and shares of language.zarr to a .ply file.
    """

    format: str
    output: Path | None
    query: str | None
    codes: bool

    def place(self, folder: Path) -> Path:
        """The file or folder to write."""
        if self.output is not None:
            return self.output
        if self.format not in _FILES:
            return folder / self.format
        name = "instances" if self.format == "instances" else "scene" if self.query is None else "answer"
        return folder / f"{name}{_FILES[self.format].suffix}"


def run(
    folder: Path, what: Exporting, options: QueryOptions, *, backend: str, device: str, precision: str
) -> None:
    """Export a scene.

    Args:
        folder: folder with the artifacts of a scene.
        options: how the query is answered.
        backend: renderer, as the key ``backend``.
        device, precision: of OpenCLIP, as the keys of the section ``models``.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others, the query has no answer, or the output
            is there already and no export.
    """
    if what.query is not None and what.format not in _OF_QUERIES:
        raise UserError(f"--query: goes with --format {' or '.join(_OF_QUERIES)}, not {what.format}")
    output = what.place(folder)
    if kind := _FILES.get(what.format):
        check_output(output, kind)
    if what.format in _CAMERAS:
        export_dataset(folder, output, _CAMERAS[what.format])
    elif what.format == "instances":
        export_instances(folder, output)
    else:
        chosen = None
        if what.query is not None:
            how = {"backend": backend, "device": device, "precision": precision}
            chosen = answer_members(folder, what.query, options, **how)
        export_gaussians(folder, output, what.format, chosen, what.codes)


def answer_members(
    folder: Path, phrase: str, options: QueryOptions, *, backend: str, device: str, precision: str
) -> Tensor:
    """Indices of the Gaussians of the best answer to a query of the whole scene. Arguments as in ``run``.

    Raises:
        UserError: the query has no answer; also as ``run``.
    """
    sources, _ = open_sources(folder)
    question = open_question(sources, [phrase], options, backend=backend, device=device, precision=precision)
    scene = question.scene
    poses, valid = camera_poses(sources.poses, sources.splats), sources.frames.read("valid")
    index = index_scene(scene, poses, scene.camera, valid)
    (answer,) = ask_scene(index, question.texts, options, most=1)
    if why := answer.refusal(question.untaught[phrase], options):
        raise UserError(f"{folder}: {phrase!r} is not exported, {why}")
    return torch.from_numpy(np.sort(answer.things[0].members))


def export_gaussians(folder: Path, output: Path, format: str, chosen: Tensor | None, codes: bool) -> None:
    """Write Gaussians as .ply or .spz.

    Args:
        chosen: (M,) int64 indices of the Gaussians to write; None for all.
        codes: also write codes and shares to a .ply file.

    Raises:
        UserError: as ``run``.
    """
    splats = open_artifact(*locate(folder, "splats"), SPLATS)
    gaussians = read_gaussians(splats)
    rows = torch.arange(gaussians.count) if chosen is None else chosen
    some = gaussians.select(rows)
    if format == "spz":
        write_spz(output, some, splats.facts["sh_degree_in_use"], antialiased=False)
    else:
        columns = geometry_columns(some)
        if codes:
            columns |= _codes(folder, splats, rows)
        write_ply(output, columns, splats.origin)
    log(f"{output}: {some.count} Gaussians")


def _codes(folder: Path, splats: Artifact, rows: Tensor) -> dict[str, np.ndarray]:
    language = open_artifact(*locate(folder, "language"), LANGUAGE)
    check_made_from(language, splats, axes=("gaussian",))
    code, share = (language.read(name)[rows.numpy()] for name in ("code", "share"))
    return code_columns(code, share, language.facts["levels"])
