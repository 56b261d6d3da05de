"""Tell a scene's story on one page: each step with its picture, its numbers, its cost and its alarms. ``egosplat story``."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.artifact_alarms import warning_lines, warnings_of
from egosplat.alarms.table import Alarm
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS, length_unit
from egosplat.errors import UserError
from egosplat.files import write_text
from egosplat.pipeline.home import make_command
from egosplat.pipeline.stages import PAGES, STAGES
from egosplat.pipeline.validation import read_document
from egosplat.progress import log
from egosplat.report.html_page import read_picture, render_page


class SceneFiles:
    """The files of a scene by their names; those that the scene does not need may be absent.

    Raises:
        UserError: a file is damaged.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = {path.name: path for path in paths}
        self.artifacts = {
            path.stem: open_artifact(path, SCHEMAS[path.stem])
            for path in paths
            if path.suffix == ".zarr" and path.stem in SCHEMAS
        }

    def has(self, stage: str) -> bool:
        """Whether the output of a stage is there."""
        return STAGES[stage].output in self.paths

    def __getitem__(self, stage: str) -> Artifact:
        return self.artifacts[stage]

    @cached_property
    def survey(self) -> dict[str, Any]:
        return read_document(self.paths["survey.json"], "survey")

    @cached_property
    def metrics(self) -> dict[str, Any]:
        return read_document(self.paths["metrics.json"], "metrics")


@dataclass(frozen=True)
class Step:
    """A step of the story, which tells of the output of a stage, with what to look for in a page's picture.

    Attributes:
        absent: what to say if the scene lacks the output.
    """

    heading: str
    stage: str
    lines: Callable[[SceneFiles], Iterator[str]]
    look: str = ""
    page: str | None = None
    absent: str = ""


def _recording(files: SceneFiles) -> Iterator[str]:
    frames = files["frames"]
    count, height, width, _ = frames.shape("rgb")
    times = frames.read("timestamp_ns")
    seconds = (times[-1] - times[0]) / 1e9 if count else 0.0
    held_out = int(frames.read("evaluation").sum())
    yield f"{count} frames of {width} x {height} pixels in {seconds:.0f} s; {held_out} of them are for evaluation only."
    yield f"Format {frames.facts['format']}, origin {frames.origin}."


def _poses(files: SceneFiles) -> Iterator[str]:
    poses = files["poses"]
    known = poses.read("registered")
    points, unit = poses.shape("points/xyz")[0], length_unit(poses)
    yield f"{int(known.sum())} of {len(known)} frames have a pose. {points} points; lengths are in {unit}."


def _survey(files: SceneFiles) -> Iterator[str]:
    motion, camera = files.survey["motion"], files.survey["camera"]
    network = "masked" if motion["masking"] != "none" else "not masked"
    if motion["share"] is None:
        yield f"Whether something moves cannot be told. What moves is {network}."
    else:
        what = "Nothing moves" if motion["static"] else f"{motion['share']:.2%} of the picture moves"
        yield f"{what}. From {motion['min_share']:.1%} on, what moves is masked; here it is {network}."
    yield f"{len(files.survey['views']['left_out'])} frames add no new view: they train nothing."
    refined = "are refined" if camera["refine_poses"] else "are kept"
    gains = "is compensated" if camera["compensate_exposure"] else "is left as it is"
    residual = camera["pose_residual_px"]
    error = "" if residual is None else f" (error {residual:.2f} px)"
    yield f"Poses {refined} while the Gaussians train{error}; exposure {gains}."


def _instances(files: SceneFiles) -> Iterator[str]:
    facts = files["instances"].facts
    counts = ", ".join(f"{count} {level}s" for level, count in facts["instances"].items())
    how = "tracks of SAM2" if facts["source"] == "tracks" else "masks of single frames, merged in 3D"
    yield f"{counts}: {how}. {int(files['instances'].read('instances/moving').sum())} are tracks of what moves."


def _crops(files: SceneFiles) -> Iterator[str]:
    facts = files["features"].facts
    yield (
        f"OpenCLIP {facts['clip']['model']} encodes each view of an instance. {facts['outliers']} views are outliers, "
        f"and {facts['slipped']} show something else: neither counts in the feature of their instance."
    )


def _moving(files: SceneFiles) -> Iterator[str]:
    facts = files["masks"].facts
    yield (
        f"{facts['transient']} of {facts['instances']} instances move; their pixels are {facts['masked_share']:.1%} of all. "
        f"The network's mean probability is {facts['mean_probability']:.2f}."
    )


def _carried(files: SceneFiles) -> Iterator[str]:
    yield f"Things that are taken up at one place and put down at another: {files['histories'].shape('carries/start')[0]}."


def _gaussians(files: SceneFiles) -> Iterator[str]:
    splats = files["splats"]
    views = splats.facts["views"]
    given = splats.facts.get("source")
    where = f"read from {given['file']}" if given else f"trained on {views['training']} frames"
    yield f"{splats.shape('means')[0]} Gaussians, {where}."
    psnr = splats.read("held_out/psnr")
    if len(psnr := psnr[np.isfinite(psnr)]):
        kind = "evaluation" if given else "held-out"
        yield f"Mean PSNR of {len(psnr)} {kind} frames: {psnr.mean():.1f} dB, the worst {psnr.min():.1f} dB."


def _language(files: SceneFiles) -> Iterator[str]:
    language = files["language"]
    with_code = (language.read("share") > 0).mean(axis=0)
    told = ", ".join(
        f"{share:.0%} of level {level}"
        for level, share in zip(language.facts["levels"], with_code, strict=True)
    )
    yield f"Gaussians with a code: {told}."


def _questions(files: SceneFiles) -> Iterator[str]:
    scores = files.metrics["scores"]["all"]
    if not scores["count"]:
        yield "No annotated thing is in the evaluation frames, so nothing is scored."
        return
    low, high = scores["accuracy_interval"] or (None, None)
    interval = "" if low is None else f" (95 % interval {low:.0%} to {high:.0%})"
    yield (
        f"{scores['accuracy']:.0%}{interval} of {scores['count']} queries point at the right thing; a random pixel would "
        f"find {scores['random_pixel']:.0%}. Mean IoU of the masks: {scores['mean_iou']:.2f}."
    )
    if presence := files.metrics.get("presence"):
        present, absent = presence["present"], presence["absent"]
        yield (
            f"Asked of the whole scene, {present['right']} of {present['asked']} things that are there are found rightly, and "
            f"{present['guessed_right']} more are right best guesses; {absent['answered']} of {absent['asked']} things that "
            "are not there are found."
        )


_NO_INSTANCES = "language.method learns from tiles of the frames, so no instances are made for it."

STEPS = (
    Step(
        "Recording",
        "frames",
        _recording,
        "Are the frames upright and sharp? The trajectory from above has to look like the walk of a person.",
        "contact_sheet",
    ),
    Step("Poses", "poses", _poses),
    Step("Survey: what the scene requires", "survey", _survey, absent="No key asks for a survey."),
    Step(
        "Instances",
        "instances",
        _instances,
        "A thing should keep its color in all frames. One color over two things is a wrong merge.",
        "instances_sheet",
        _NO_INSTANCES,
    ),
    Step(
        "Crops",
        "features",
        _crops,
        "Each row shows one instance. Crossed-out crops should be those that show something else.",
        "crops_sheet",
        _NO_INSTANCES,
    ),
    Step(
        "What moves",
        "masks",
        _moving,
        "People and carried things should be masked; walls and furniture should not.",
        "transient_sheet",
        "Nothing is masked: the scene is static, or splats.masking asks for no masks of instances.",
    ),
    Step(
        "Gaussians",
        "splats",
        _gaussians,
        "Renders should look like the held-out frames next to them. The curves should have become flat.",
        "splats_sheet",
    ),
    Step(
        "What is carried",
        "histories",
        _carried,
        "Each arrow should lead from where a thing was to where it is put down. Hands and people are not things.",
        "carries_sheet",
        "Nothing is tracked because it moves.",
    ),
    Step(
        "Language",
        "language",
        _language,
        "Similar colors mean similar features: parts of one thing agree, different things differ.",
        "language_sheet",
    ),
    Step(
        "Questions",
        "metrics",
        _questions,
        "The best answers are on the left, the worst on the right. What do the worst have in common?",
        "queries_sheet",
        "The recording has no annotations, so its answers are not scored.",
    ),
)


def run(paths: Sequence[Path], output: Path, title: str) -> None:
    """Write the page of a scene from its files: artifacts, pages, survey.json, metrics.json.

    Raises:
        UserError: a file is missing or damaged.
    """
    if missing := [path for path in paths if not path.exists()]:
        raise UserError(f"{missing[0]}: does not exist. Make it: {make_command(missing[0])}")
    files = SceneFiles(paths)
    scene = files.paths.get(STAGES["scene_page"].output)
    text = render_page(
        "egosplat.report",
        "story.html.j2",
        generator="egosplat story",
        title=title,
        steps=[_tell(step, files) for step in STEPS],
        costs=_costs(files),
        warnings=_warnings(files),
        scene=None if scene is None else scene.read_text(encoding="utf-8"),
    )
    write_text(output, text)
    log(f"{output}: {len(text) / 1e6:.1f} MB")


def _tell(step: Step, files: SceneFiles) -> dict[str, Any]:
    """A step as the page shows it; ``picture`` is a data URI or None."""
    told: dict[str, Any] = {"heading": step.heading, "lines": [step.absent], "look": "", "picture": None}
    if files.has(step.stage):
        told["lines"] = list(step.lines(files))
        if step.page is not None and files.has(step.page):
            picture = read_picture(files.paths[STAGES[step.page].output])
            told |= {"look": step.look, "picture": picture.address}
    return told


def _costs(files: SceneFiles) -> list[Mapping[str, Any]]:
    """Provenance of the stages that tell their costs, in the order of the pipeline."""
    records = {one.provenance["stage"]: one.provenance for one in files.artifacts.values()}
    records |= {"survey": files.survey["provenance"]} if files.has("survey") else {}
    records |= {"metrics": files.metrics["provenance"]} if files.has("metrics") else {}
    order = [name for name in STAGES if name not in PAGES]
    return sorted(records.values(), key=lambda record: order.index(record["stage"]))


def _warnings(files: SceneFiles) -> list[str]:
    found = warnings_of(*files.artifacts.values())
    if files.has("metrics"):
        alarms = [Alarm(**alarm) for alarm in files.metrics["alarms"]]
        found += warning_lines(None, (alarm for alarm in alarms if alarm.key.startswith("metrics.")))
    return found
