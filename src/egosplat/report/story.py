"""Tell a scene's story on one page: each step with its picture, its numbers, its cost and its alarms. ``egosplat story``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.artifact_alarms import warning_lines, warnings_of
from egosplat.alarms.table import Alarm
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS, length_unit, seconds_of
from egosplat.errors import UserError
from egosplat.files import write_text
from egosplat.pipeline.home import make_command
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.validation import read_document
from egosplat.progress import log
from egosplat.report.html_page import read_picture, render_page


def run(paths: Sequence[Path], output: Path, title: str) -> None:
    """Write the page of a scene from its files: artifacts, pages, survey.json, metrics.json (UserError: a
    file is missing or damaged)."""
    if missing := [path for path in paths if not path.exists()]:
        raise UserError(f"{missing[0]}: does not exist. Make it: {make_command(missing[0])}")
    files = {path.name: path for path in paths}
    given = {name: files[stage.output] for name, stage in STAGES.items() if stage.output in files}
    artifacts = {name: open_artifact(path, SCHEMAS[name]) for name, path in given.items() if name in SCHEMAS}
    documents = {name: read_document(given[name], name) for name in ("survey", "metrics") if name in given}
    made = {name: artifact.provenance for name, artifact in artifacts.items()}
    made |= {name: document["provenance"] for name, document in documents.items()}
    told = {
        name: artifact.facts | _NUMBERS.get(name, lambda _: {})(artifact)
        for name, artifact in artifacts.items()
    }
    alarms = [Alarm(**alarm) for alarm in documents.get("metrics", {"alarms": ()})["alarms"]]
    scored = [alarm for alarm in alarms if alarm.key.startswith("metrics.")]
    text = render_page(
        "egosplat.report",
        "story.html.j2",
        generator="egosplat story",
        title=title,
        told=told | documents,
        pictures={name: read_picture(path) for name, path in given.items() if path.suffix == ".png"},
        costs=[made[name] for name in STAGES if name in made],
        warnings=warnings_of(*artifacts.values()) + warning_lines(None, scored),
        scene=given["scene_page"].read_text(encoding="utf-8") if "scene_page" in given else None,
    )
    write_text(output, text)
    log(f"{output}: {len(text) / 1e6:.1f} MB")


def _frames(frames: Artifact) -> dict[str, Any]:
    count, height, width, _ = frames.shape("rgb")
    times = {"seconds": seconds_of(frames)[-1] if count else 0.0, "held_out": frames.read("evaluation").sum()}
    return {"count": count, "height": height, "width": width, "origin": frames.origin} | times


def _poses(poses: Artifact) -> dict[str, Any]:
    known = poses.read("registered")
    counts = {"count": len(known), "known": known.sum(), "points": poses.shape("points/xyz")[0]}
    return counts | {"unit": length_unit(poses)}


def _splats(splats: Artifact) -> dict[str, Any]:
    psnr = splats.read("held_out/psnr")
    return {"count": splats.shape("means")[0], "psnr": psnr[np.isfinite(psnr)]}


# By artifact, what the page tells beside its facts.
_NUMBERS: dict[str, Callable[[Artifact], dict[str, Any]]] = {
    "frames": _frames,
    "poses": _poses,
    "instances": lambda instances: {"moving": instances.read("instances/moving").sum()},
    "splats": _splats,
    "histories": lambda histories: {"carries": histories.shape("carries/start")[0]},
    "language": lambda language: {"with_code": (language.read("share") > 0).mean(axis=0)},
}
