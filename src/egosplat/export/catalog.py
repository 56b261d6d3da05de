"""Tell what is in a scene, in a table and in files: ``egosplat catalog``."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import pandas as pd
import torch

from egosplat.errors import UserError
from egosplat.export.gaussians import geometry_columns, write_ply
from egosplat.files import atomic_directory, check_new_folder, check_output, write_json, write_text
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.home import ASKED, check_scene_folder
from egosplat.progress import log
from egosplat.query.answers import Answer
from egosplat.query.catalog import catalog
from egosplat.query.command import align_rows, answer_rows, carried_table, describe
from egosplat.query.finished_scene import Scene, open_scene
from egosplat.query.options import AskingOptions

_PLACE = ("x", "y", "z", "size_x", "size_y", "size_z")


def run(
    folder: Path, options: AskingOptions, output: Path | None, overwrite: bool, as_json: bool
) -> Iterator[str]:
    """Yield the table of what is in a scene and that of what is carried, or JSON, and a line about the output, if it is to be written:
    .csv, .json, or a folder with a .ply file of each thing (UserError: it cannot be written, or as ``catalog``)."""
    if output is not None and output.suffix:
        if output.suffix.lower() not in (".csv", ".json"):
            raise UserError(f"{output}: is no table; give --output a name in .csv or .json, or of a folder")
        check_output(output, f"things{output.suffix.lower()}", overwrite=overwrite)
    elif output is not None:
        check_new_folder(output)
    check_scene_folder(folder, ASKED)
    scene = open_scene(folder, options)
    things, grading = catalog(scene), scene.grading()
    header = f"thing,answer,{grading.measure},level,center [{scene.unit}],size [{scene.unit}],frame"
    rows = [tuple(header.split(","))]
    for thing in things:
        rows += answer_rows(replace(thing, phrase=" or ".join([thing.phrase, *thing.also])), grading)
    told = f"nothing is a best guess or found; for words, egosplat query {quote(str(folder))} cup"
    rows += [] if things else [(told,)]
    notice = notice_of_artifacts(scene.made_from.found.values())
    table = "\n".join(filter(None, [f"{folder}, origin {scene.origin}", notice, align_rows(rows)]))
    described = [describe(scene, one) for one in things]
    yield json.dumps(described, indent=1) if as_json else table
    if (carried := carried_table(things, scene.unit, None)) and not as_json:
        yield f"\n{carried}"
    if output is not None:
        _write(scene, things, described, output)
        log(f"{output}: {len(things)} things")


def _write(scene: Scene, things: Sequence[Answer], described: list[dict[str, Any]], output: Path) -> None:
    if output.suffix.lower() == ".json":
        return write_json(output, described)
    records = [_record(scene, thing) for thing in things]
    columns = None if records else ["name", "also", "answer", "origin", "unit"]
    if output.suffix:
        write_text(output, pd.DataFrame(records, columns=columns).convert_dtypes().to_csv(index=False))
    else:
        gaussians = scene.gaussians.to(torch.device("cpu"))
        with atomic_directory(output) as folder:
            for number, (answer, record) in enumerate(zip(things, records, strict=True), 1):
                for thing in answer.things:
                    record["file"] = f"{number:02d}_{answer.phrase.replace(' ', '_')}.ply"
                    chosen = gaussians.select(torch.from_numpy(thing.members))
                    write_ply(folder / record["file"], geometry_columns(chosen), scene.origin)
            pd.DataFrame(records, columns=columns).convert_dtypes().to_csv(folder / "things.csv", index=False)


def _record(scene: Scene, answer: Answer) -> dict[str, Any]:
    """What files tell of a thing, without what is not known; lengths in the unit of the scene."""
    record: dict[str, Any] = {"name": answer.phrase, "also": ", ".join(answer.also)}
    record |= {"answer": answer.refusal or answer.grade, "origin": scene.origin, "unit": scene.unit}
    for thing in answer.things:
        record |= {scene.grading().measure: thing.rating, "level": thing.level, "frame": thing.frame}
        place = [*thing.center.round(4).tolist(), *thing.size.round(4).tolist()]
        record |= dict(zip(_PLACE, place, strict=True))
    return record | ({"carried": ", ".join(one.told for one in answer.history)} if answer.history else {})
