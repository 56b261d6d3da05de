"""How well what moves is found: by the network alone, and with instances, for a range of thresholds.

Reads transient.zarr of each scene folder, and segments.zarr where there is one; the truth comes from the synthetic
recording, whose every frame is annotated. True instances show what the network is worth if segmentation were perfect.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/masks.zarr
    python benchmarks/transient.py results/adt/scene{1,2,3,4,5} > benchmarks/transient.md
"""

import sys
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

from transient_bench.scores import MaskScores, total
from transient_bench.truth import Truth, read_truth

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.transient import TRANSIENT
from egosplat.errors import UserError
from egosplat.progress import log
from egosplat.transient.refinement import InstanceScores, refined_mask, transient_instances

THRESHOLDS = tuple(round(0.05 * step, 2) for step in range(1, 20))
ALONE = 0.5
"""Probability from which on the network alone calls a pixel transient."""

Labels = NDArray[np.int32]


class Scene:
    """One scene's artifacts with the truth, read once."""

    def __init__(self, folder: Path) -> None:
        self.name = f"{folder.parent.name}/{folder.name}"
        frames = open_artifact(folder / "frames.zarr", FRAMES)
        self.valid, self.train = frames.read("valid"), frames.read("train")
        self.truth: Truth = read_truth(folder / "recording", frames)
        self.labels = list(self.truth.all_labels())
        transient = open_artifact(folder / "transient.zarr", TRANSIENT)
        self.seconds = transient.facts["training_s"]
        self.probability = [transient.row("probability", frame) for frame in range(len(self.labels))]
        path = folder / "segments.zarr"
        self.segments: Artifact | None = open_artifact(path, SEGMENTS) if path.exists() else None

    def alone(self) -> MaskScores:
        """The network alone."""
        return self._scores([probability >= ALONE for probability in self.probability])

    def refined_by_truth(self) -> dict[float, MaskScores]:
        """With true instances, for each threshold."""
        labels = [true[None] for true in self.labels]
        return self._refined(labels, np.zeros(len(self.truth.moves), np.int8), {0})

    def refined_by_segments(self) -> dict[float, MaskScores]:
        """With the instances of segments.zarr, all levels."""
        segments = self.segments
        if segments is None:
            return {}
        labels = [segments.row("labels", frame) for frame in range(len(self.labels))]
        return self._refined(labels, segments.read("instances/level"), set(range(labels[0].shape[0])))

    def _refined(
        self, labels: list[Labels], level: NDArray[np.int8], levels: set[int]
    ) -> dict[float, MaskScores]:
        found = InstanceScores(len(level))
        for frame in np.flatnonzero(self.train):
            found.add(labels[frame], self.probability[frame])
        scores, pixels = found.scores, found.pixels
        chosen = {t: transient_instances(scores, pixels, level, t, levels) for t in THRESHOLDS}
        return {t: self._scores([refined_mask(some, one) for some in labels]) for t, one in chosen.items()}

    def _scores(self, masks: list[NDArray[np.bool_]]) -> MaskScores:
        scores = MaskScores()
        for mask, labels in zip(masks, self.labels, strict=True):
            scores.add(mask, labels, self.truth.moves, self.valid)
        return scores


def cells(scores: MaskScores) -> str:
    """Columns of one row."""
    values = (scores.iou, scores.precision, scores.recall, scores.missed_share, scores.still_masked)
    return " | ".join("-" if np.isnan(value) else f"{value:.3f}" for value in values)


def best(tables: list[dict[float, MaskScores]]) -> float:
    """The one threshold with the highest mean IoU over the scenes."""
    return max(THRESHOLDS, key=lambda t: np.mean([table[t].iou for table in tables]))


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Print the tables."""
    scenes = []
    for folder in folders:
        log(f"reading {folder}")
        scenes.append(Scene(folder))
    kinds = {
        "true instances": [scene.refined_by_truth() for scene in scenes],
        "segments.zarr": [scene.refined_by_segments() for scene in scenes],
    }
    alone = [scene.alone() for scene in scenes]
    click.echo("# What moves\n")
    click.echo("| scene | masks | T | IoU | precision | recall | missed | still, masked |")
    click.echo("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    rows = [(scene.name, "network alone", ALONE, one) for scene, one in zip(scenes, alone, strict=True)]
    rows.append(("all", "network alone", ALONE, total(alone)))
    for kind, tables in kinds.items():
        if not all(tables):
            continue
        t = best(tables)
        rows += [(scene.name, kind, t, table[t]) for scene, table in zip(scenes, tables, strict=True)]
        rows.append(("all", kind, t, total(table[t] for table in tables)))
    for name, kind, t, scores in rows:
        click.echo(f"| {name} | {kind} | {t:.2f} | {cells(scores)} |")
    for kind, tables in kinds.items():
        if all(tables):
            _sweep(kind, [scene.name for scene in scenes], tables)


def _sweep(kind: str, names: list[str], tables: list[dict[float, MaskScores]]) -> None:
    click.echo(f"\n## IoU by threshold, {kind}\n")
    click.echo("| T | " + " | ".join(names) + " | mean |")
    click.echo("| ---: |" + " ---: |" * (len(names) + 1))
    for t in THRESHOLDS:
        ious = [table[t].iou for table in tables]
        click.echo(f"| {t:.2f} | " + " | ".join(f"{iou:.3f}" for iou in (*ious, np.mean(ious))) + " |")


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"transient.py: {error}")
