"""What aggregation is worth where the tracks are right: scenes asked anew with true instances in SAM2's place.

    snakemake --cores 2 results/adt/scene{2,4,5}/metrics.json
    python benchmarks/true_instances.py results/adt/scene{2,4,5} > benchmarks/true_instances.md

Every frame of a synthetic recording is annotated: these instances become segments.zarr, of one level, and view features,
features, language and scores are made of them as ever, on the scene's own Gaussians. `view` supervises with each view's own
feature, `average` with the mean of that and the consistent one, which is the paper's and the default.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from scores_bench.comparing import (
    METHOD,
    SCORES,
    accuracy_difference,
    chance,
    iou_difference,
    paired,
    queries_of,
    told,
)
from transient_bench.truth import read_truth

from egosplat.artifacts import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config, stage_values
from egosplat.pipeline.stages import stage_function
from egosplat.progress import log, track
from egosplat.tables.scored_scenes import ScoredScene, read_scored_scene

PRESETS = Path(__file__).resolve().parents[1] / "config" / "presets"
TARGETS = ("view", "average")
HEADER = (
    "| scene | instances | supervised with | queries | accuracy | of what stays | of what can move | mIoU |\n"
    "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |"
)


def true_segments(folder: Path, output: Path) -> None:
    """Write segments.zarr of what is annotated."""
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    truth = read_truth(folder / "recording", frames)
    valid, count = frames.read("valid"), len(truth.names)
    with create(output, SEGMENTS, provenance.begin_from("segments", {}, [frames])) as artifact:
        artifact.allocate("labels", (len(frames.read("train")), 1, *valid.shape))
        for frame, labels in enumerate(track(list(truth.all_labels()), "writing true instances")):
            artifact.put_row("labels", frame, np.where(valid, labels, -1)[None].astype(np.int32))
        artifact.put("instances/level", np.zeros(count, np.int8))
        artifact.put("instances/predicted_iou", np.ones(count, np.float32))
        artifact.put("instances/stability", np.ones(count, np.float32))
        artifact.put("instances/first_frame", np.zeros(count, np.int64))
        artifact.facts = {"levels": ["whole"], "instances": {"whole": count}, "segmenter": "truth"}


def asked(folder: Path, work: Path, target: str) -> ScoredScene:
    """The scene's scores with the segments and view features in ``work``."""
    config = configuration.resolve({"features": {"target": target}}, PRESETS)
    own = {name: folder / f"{name}.zarr" for name in ("frames", "poses", "annotations", "splats")}
    masking = open_artifact(own["splats"], SPLATS).provenance["options"]["masking"]
    made = {name: work / target / f"{name}.zarr" for name in ("features", "language")}
    run("features", config, view_features=work / "view_features.zarr", output=made["features"])
    run(
        "language",
        config,
        **{name: own[name] for name in ("frames", "poses", "splats")},
        segments=work / "segments.zarr",
        features=made["features"],
        survey=folder / "survey.json",
        transient=None,
        masks=folder / "masks.zarr" if masking == "refined" else None,
        output=made["language"],
    )
    scores = work / target / "metrics.json"
    title = f"{folder.parent.name}/{folder.name}"
    run("metrics", config, **own, **made, title=title, output=scores)
    return read_scored_scene(scores)


def run(stage: str, config: Config, **paths: object) -> None:
    """A stage as its rule runs it."""
    keys = stage_values(stage, config)
    stage_function(stage)(**paths, **keys)


def by_truth(folder: Path) -> dict[str, ScoredScene]:
    """Scores by target."""
    with TemporaryDirectory() as name:
        work = Path(name)
        true_segments(folder, work / "segments.zarr")
        config = configuration.resolve({}, PRESETS)
        frames, segments = folder / "frames.zarr", work / "segments.zarr"
        run("view_features", config, frames=frames, segments=segments, output=work / "view_features.zarr")
        return {target: asked(folder, work, target) for target in TARGETS}


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    rows, every, scenes = [], [], []
    for folder in folders:
        log(f"{folder}")
        found = by_truth(folder)
        for target, one in found.items():
            cells = [one.cell(*score) for score in SCORES]
            name = f"{folder.parent.name}/{folder.name}"
            rows.append(f"| {name} | true | {target} | {cells[0].queries} | {' | '.join(map(told, cells))} |")
        scenes.append(found["average"])
        every.append(paired(found["average"], found["view"]))
    click.echo(f"# Aggregation of right tracks\n\nAccuracy and mIoU in percent. {METHOD} {chance(scenes)}\n")
    click.echo("\n".join([HEADER, *rows]))
    click.echo(
        f"\n`average` against `view`, the same {queries_of(every)} queries, in percentage points: accuracy "
        f"{accuracy_difference(every)}, mIoU {iou_difference(every)}."
    )


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"true_instances.py: {error}")
