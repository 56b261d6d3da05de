"""Accuracy of transient masks: of the network alone, and refined by instances, over a range of thresholds.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/masks.zarr
    python -m benchmarks.transient results/adt/scene{1,2,3,4,5} > benchmarks/transient/README.md

Reads `transient.zarr` of each scene, and `instances.zarr` where it exists. The truth comes from the synthetic recording, whose
frames are all annotated. True instances show what the network would give with perfect segmentation.
"""

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import command, markdown, scene_folders
from benchmarks.transient.scores import MaskScores, total
from benchmarks.transient.truth import read_truth
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, TRANSIENT, is_track
from egosplat.moving_regions import InstanceScores
from egosplat.pipeline.home import title_of
from egosplat.progress import log
from egosplat.transient.masks_stage import (
    LEAST_OUTSTANDING,
    PIXEL_PROBABILITY,
    looks_static,
    refined_mask,
    transient_instances,
)

THRESHOLDS = tuple(round(0.05 * step, 2) for step in range(1, 20))
# Least probability of a pixel that the network alone masks.
ALONE = 0.5

COLUMNS = ("scene", "masks", "T", "IoU", "precision", "recall", "missed", "static, masked")

Labels = NDArray[np.int32]
# Scores by threshold.
Sweep = dict[float, MaskScores]


class Scene:
    """One scene's artifacts and truth, read once."""

    def __init__(self, folder: Path) -> None:
        log(f"reading {folder}")
        self.name = title_of(folder)
        frames = open_artifact(folder / "frames.zarr", FRAMES)
        self.valid, self.train = frames.read("valid"), frames.read("train")
        self.truth = read_truth(folder / "recording", frames)
        self.labels = list(self.truth.all_labels())
        transient = open_artifact(folder / "transient.zarr", TRANSIENT)
        self.probability = [transient.row("probability", frame) for frame in range(len(self.labels))]
        self.stands_out = [transient.row("stands_out", frame) for frame in range(len(self.labels))]
        self.measured = np.isfinite(transient.read("residual_scale"))
        self.compared = transient.read("compared")
        path = folder / "instances.zarr"
        self.instances = open_artifact(path, INSTANCES) if path.exists() else None

    def alone(self) -> MaskScores:
        """Scores of the network alone."""
        return self._scores([probability >= ALONE for probability in self.probability])

    def refined_by_segments(self) -> Sweep:
        """Scores refined by the instances of instances.zarr at all levels; none without that file."""
        if self.instances is None:
            return {}
        labels = [self.instances.row("labels", frame) for frame in range(len(self.labels))]
        return self.refined(labels, is_track(self.instances))

    def refined(self, labels: list[Labels], may_move: NDArray[np.bool_]) -> Sweep:
        found, outstanding = InstanceScores(len(may_move)), InstanceScores(len(may_move))
        for frame in np.flatnonzero(self.train):
            found.add(labels[frame], self.probability[frame])
            if self.measured[frame]:
                outstanding.add(np.where(self.compared, labels[frame], -1), self.stands_out[frame])
        static = looks_static(outstanding, LEAST_OUTSTANDING) | ~may_move
        chosen = {t: transient_instances(found.scores, found.pixels, t) & ~static for t in THRESHOLDS}
        return {t: self._scores(self._masks(labels, one)) for t, one in chosen.items()}

    def _masks(self, labels: list[Labels], chosen: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
        return [
            refined_mask(some, chosen) & (probability >= PIXEL_PROBABILITY)
            for some, probability in zip(labels, self.probability, strict=True)
        ]

    def _scores(self, masks: list[NDArray[np.bool_]]) -> MaskScores:
        scores = MaskScores()
        for mask, labels in zip(masks, self.labels, strict=True):
            scores.add(mask, labels, self.truth.moves, self.valid)
        return scores


def row(name: str, kind: str, threshold: float, scores: MaskScores) -> list[str]:
    """A row of the first table."""
    values = (scores.iou, scores.precision, scores.recall, scores.missed_share, scores.still_masked)
    return [name, kind, f"{threshold:.2f}", *("-" if np.isnan(one) else f"{one:.3f}" for one in values)]


def rows_of(kind: str, names: list[str], threshold: float, scores: list[MaskScores]) -> list[list[str]]:
    """Rows of all scenes, and of their counts together."""
    rows = [row(name, kind, threshold, one) for name, one in zip(names, scores, strict=True)]
    return [*rows, row("all", kind, threshold, total(scores))]


def best(sweeps: list[Sweep]) -> float:
    """The one threshold with the highest mean IoU over the scenes."""
    return max(THRESHOLDS, key=lambda t: np.mean([one[t].iou for one in sweeps]))


def by_threshold(names: list[str], sweeps: list[Sweep]) -> str:
    """IoU of each scene and their mean, a row for each threshold."""
    rows = []
    for t in THRESHOLDS:
        ious = [one[t].iou for one in sweeps]
        rows.append([f"{t:.2f}", *(f"{iou:.3f}" for iou in (*ious, np.mean(ious)))])
    return markdown(["T", *names, "mean"], rows, words=0)


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the tables."""
    scenes = [Scene(folder) for folder in folders]
    names = [scene.name for scene in scenes]
    sweeps = {
        "true instances": [
            scene.refined([true[None] for true in scene.labels], np.ones(len(scene.truth.moves), bool))
            for scene in scenes
        ],
        "instances.zarr": [scene.refined_by_segments() for scene in scenes],
    }
    sweeps = {kind: own for kind, own in sweeps.items() if all(own)}
    rows = rows_of("network alone", names, ALONE, [scene.alone() for scene in scenes])
    for kind, own in sweeps.items():
        rows += rows_of(kind, names, best(own), [one[best(own)] for one in own])
    click.echo("# Transient masks\n\nMade by `python -m benchmarks.transient`.\n")
    click.echo(markdown(COLUMNS, rows, words=2))
    for kind, own in sweeps.items():
        click.echo(f"\n## IoU by threshold, {kind}\n\n{by_threshold(names, own)}")


if __name__ == "__main__":
    main()
