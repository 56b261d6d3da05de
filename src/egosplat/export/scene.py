"""Write a finished scene for other programs: ``egosplat export``."""

import csv
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import LANGUAGE, SPLATS
from egosplat.errors import UserError
from egosplat.export.dataset import export_dataset
from egosplat.export.formats import check_export
from egosplat.export.ply import code_columns, geometry_columns, write_instances, write_ply
from egosplat.export.rerun_recording import export_rerun
from egosplat.export.spz import write_spz
from egosplat.files import atomic_file
from egosplat.gaussians.io import read_gaussians
from egosplat.histories.told import Carried
from egosplat.pipeline.home import make_command
from egosplat.progress import log
from egosplat.query.finished_scene import Scene, open_scene
from egosplat.query.grades import GUESS
from egosplat.query.options import AskingOptions
from egosplat.viewing.command import write_page

# Seconds since the first frame, and places in the world.
_COLUMNS = (
    *("name", "from_s", "until_s", "start_x", "start_y", "start_z", "end_x", "end_y", "end_z"),
    *("size", "frame"),
)


def export_scene(
    scene: Scene,
    path: str | Path,
    *,
    format: str | None = None,
    query: str | None = None,
    codes: bool = True,
    overwrite: bool = False,
) -> None:
    """Write a scene for other programs, as ``egosplat export``.

    Args:
        path: file or folder to write.
        format: ply, spz, instances, carries, nerfstudio, colmap, html or rrd; None for what the suffix of ``path`` says.
        query: only the Gaussians of the best answer to these words; ply and spz. Boxes of the answers; rrd.
        codes: also write the language codes; ply.
        overwrite: whether a file that is there may be replaced.

    Raises:
        UserError: the query has no answer, or a file is at ``path``.

    >>> egosplat.export_scene(scene, "couch.ply", query="couch")
    """
    format, path = check_export(scene.folder, Path(path), format, query, codes=codes, overwrite=overwrite)
    export_folder(scene.folder, path, format, query, codes, scene.options, scene)


def export_folder(
    folder: Path,
    output: Path,
    format: str,
    query: str | None,
    codes: bool,
    options: AskingOptions,
    scene: Scene | None = None,
) -> None:
    """Export a scene or variant; arguments as of ``export_scene``, after ``check_export``.

    Args:
        options: how a query is answered.
        scene: the scene, if it is open; else what needs it opens it.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others, or the query has no answer.
    """
    if format in ("nerfstudio", "colmap"):
        export_dataset(folder, output, format)
    elif format == "instances":
        write_instances(folder, output)
    elif format == "carries":
        export_carries(scene or open_scene(folder, options), output)
    elif format == "html":
        write_page(folder, output, options)
    elif format == "rrd":
        phrases = [phrase.strip() for phrase in (query or "").split(",") if phrase.strip()]
        export_rerun(scene or open_scene(folder, options), output, phrases)
    else:
        chosen = None if query is None else answer_members(scene or open_scene(folder, options), query)
        _export_gaussians(folder, output, format, chosen, codes=codes)


def export_carries(scene: Scene, output: Path) -> None:
    """Write a table of what is carried (UserError: histories.zarr is not there, is damaged, or is of other Gaussians)."""
    if scene.histories is None:
        path = scene.folder / "histories.zarr"
        raise UserError(f"{path}: nothing tells what is carried in this scene. Make it: {make_command(path)}")
    carried = scene.carried()
    with atomic_file(output) as scratch, scratch.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(_COLUMNS)
        table.writerows(_cells(*one) for one in carried)
    log(f"{output}: {len(carried)} carries, {sum(bool(name) for name, _ in carried)} with a name")


def _cells(name: str, one: Carried) -> list[str]:
    """A row; a place that is not known is empty."""
    places = [
        cell
        for place, known in ((one.start, one.start_is_known), (one.end, one.end_is_known))
        for cell in ([f"{value:.6g}" for value in place] if known else [""] * 3)
    ]
    times = [f"{value:.3f}" for value in (one.from_s, one.until_s)]
    return [name, *times, *places, f"{one.size:.6g}", str(one.frame)]


def answer_members(scene: Scene, phrase: str) -> Tensor:
    """Indices of the Gaussians of the best answer to a query of the whole scene.

    Raises:
        UserError: the query has no answer; also as ``Scene.ask``.
    """
    [answer] = scene.ask(phrase, most=1)
    if answer.refusal:
        raise UserError(f"{scene.folder}: {phrase!r} is not exported, {answer.refusal}")
    if answer.grade == GUESS:
        log(f"{phrase!r} is a best guess, with a probability of {scene.grading().shown(answer.rating)}")
    return torch.from_numpy(np.sort(answer.things[0].members))


def _export_gaussians(folder: Path, output: Path, format: str, chosen: Tensor | None, *, codes: bool) -> None:
    """Write the ``chosen`` Gaussians, (M,) int64 indices, or all."""
    splats = open_artifact(locate(folder, "splats")[0], SPLATS)
    gaussians = read_gaussians(splats)
    rows = torch.arange(gaussians.count) if chosen is None else chosen
    some = gaussians.select(rows)
    if format == "spz":
        write_spz(output, some, splats.facts["sh_degree_in_use"])
    else:
        columns = geometry_columns(some)
        if codes:
            language = open_artifact(locate(folder, "language")[0], LANGUAGE)
            check_made_from(language, splats, axes=("gaussian",))
            code, share = (language.read(name)[rows.numpy()] for name in ("code", "share"))
            columns |= code_columns(code, share, language.facts["levels"])
        write_ply(output, columns, splats.origin)
    log(f"{output}: {some.count} Gaussians")
