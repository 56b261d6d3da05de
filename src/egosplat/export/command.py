"""Write a finished scene for other programs: ``egosplat export``."""

import csv
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES, LANGUAGE, SPLATS
from egosplat.errors import UserError
from egosplat.export.dataset import export_dataset, write_colmap, write_nerfstudio
from egosplat.export.formats import Exporting
from egosplat.export.instance_cloud import export_instances
from egosplat.export.page import write_page
from egosplat.export.ply import code_columns, geometry_columns, write_ply
from egosplat.export.rerun_recording import export_rerun
from egosplat.export.spz import write_spz
from egosplat.files import atomic_file
from egosplat.gaussians.io import read_gaussians
from egosplat.histories.told import Carried
from egosplat.pipeline.home import make_command
from egosplat.progress import log
from egosplat.query.finished_scene import Scene
from egosplat.query.grades.calibration import GUESS
from egosplat.query.opening import open_scene
from egosplat.query.options import AskingOptions
from egosplat.viewing.options import ScenePageOptions

# Seconds since the first frame, and places in the world.
_COLUMNS = (
    *("name", "from_s", "until_s", "start_x", "start_y", "start_z", "end_x", "end_y", "end_z"),
    *("size", "frame"),
)

_CAMERAS = {"nerfstudio": write_nerfstudio, "colmap": write_colmap}


def run(folder: Path, what: Exporting, options: AskingOptions, scene: Scene | None = None) -> None:
    """Export a scene.

    Args:
        folder: folder with the artifacts of a scene.
        what: of ``plan_export``.
        options: how a query is answered.
        scene: the scene, if it is open; else a query opens it.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others, or the query has no answer.
    """
    if what.format in _CAMERAS:
        export_dataset(folder, what.output, _CAMERAS[what.format])
    elif what.format == "instances":
        export_instances(folder, what.output)
    elif what.format == "carries":
        export_carries(scene or open_scene(folder, options), what.output)
    elif what.format == "html":
        clip = open_artifact(*locate(folder, "features"), FEATURES).facts["clip"]
        files = {"clip_model": clip["model"], "clip_checkpoint": clip["checkpoint"]}
        keys = {name: getattr(options, name) for name in AskingOptions.model_fields}
        write_page(folder, what.output, ScenePageOptions(**keys | files))
    elif what.format == "rrd":
        phrases = [phrase.strip() for phrase in (what.query or "").split(",") if phrase.strip()]
        export_rerun(scene or open_scene(folder, options), what.output, phrases)
    else:
        chosen = None
        if what.query is not None:
            chosen = answer_members(scene or open_scene(folder, options), what.query)
        export_gaussians(folder, what, chosen)


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


def export_gaussians(folder: Path, what: Exporting, chosen: Tensor | None) -> None:
    """Write Gaussians as .ply or .spz.

    Args:
        chosen: (M,) int64 indices of the Gaussians to write; None for all.

    Raises:
        UserError: as ``run``.
    """
    splats = open_artifact(*locate(folder, "splats"), SPLATS)
    gaussians = read_gaussians(splats)
    rows = torch.arange(gaussians.count) if chosen is None else chosen
    some = gaussians.select(rows)
    if what.format == "spz":
        write_spz(what.output, some, splats.facts["sh_degree_in_use"], antialiased=False)
    else:
        columns = geometry_columns(some)
        if what.codes:
            columns |= _codes(folder, splats, rows)
        write_ply(what.output, columns, splats.origin)
    log(f"{what.output}: {some.count} Gaussians")


def _codes(folder: Path, splats: Artifact, rows: Tensor) -> dict[str, np.ndarray]:
    language = open_artifact(*locate(folder, "language"), LANGUAGE)
    check_made_from(language, splats, axes=("gaussian",))
    code, share = (language.read(name)[rows.numpy()] for name in ("code", "share"))
    return code_columns(code, share, language.facts["levels"])
