"""Instances that are merged in 3D against the tracks or masks they come from, and against each threshold.

    snakemake --cores 2 results/adt/scene{2,3}/segments.zarr
    python -m benchmarks.instances results/adt/scene{2,3} > benchmarks/instances/README.md

The truth is the annotation of every frame of a synthetic recording, at the level of wholes. Frames are scored at half their
size, every third one. ``video_scores.py`` describes the columns.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import command, markdown, scene_folders, survey_of, time_call
from benchmarks.instances.video_scores import VideoScores, score_level
from benchmarks.transient.truth import read_truth
from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, SEGMENTS
from egosplat.gaussians.training_views import split_views
from egosplat.instances.geometry import train_geometry
from egosplat.instances.lifted_masks import lift
from egosplat.instances.moving import MovingTracks
from egosplat.instances.options import InstancesOptions
from egosplat.instances.rendering import render_things
from egosplat.instances.things import beliefs, find_things
from egosplat.pipeline.home import title_of
from egosplat.progress import log

# Every so many frames are scored, at every second pixel of both axes.
FRAME_STEP, PIXEL_STEP = 3, 2

# Half and twice the default of each threshold, as far as they are in its range; and the merging without a step.
CHANGES: dict[str, dict[str, float]] = {
    "defaults": {},
    "inside 0.25": {"inside": 0.25},
    "inside 0.9": {"inside": 0.9},
    "merge_iou 0.2": {"merge_iou": 0.2},
    "merge_iou 0.5": {"merge_iou": 0.5},
    "merge_iou 0.8": {"merge_iou": 0.8},
    "common 0.1": {"common": 0.1},
    "common 0.4": {"common": 0.4},
    "drop_iou 0.15": {"drop_iou": 0.15},
    "drop_iou 0.6": {"drop_iou": 0.6},
    "claimed 0.25": {"claimed": 0.25},
    "no masks dropped": {"drop_iou": 0.0},
    "no instances dropped": {"claimed": 1.0},
    "no merging": {"merge_iou": 1.0, "claimed": 1.0},
}
# Where the thresholds are.
CONSTANTS = {
    "inside": "egosplat.instances.lifted_masks.INSIDE",
    "merge_iou": "egosplat.instances.merging.MERGE_IOU",
    "common": "egosplat.instances.merging.COMMON",
    "drop_iou": "egosplat.instances.things._DROP_IOU",
    "claimed": "egosplat.instances.things._CLAIMED",
}
COLUMNS = ("scene", "change", "instances", "IoU over time", "switches", "fragments", "held", "CPU-s")

Labels = NDArray[np.int32]


class Scene:
    """A scene with masks of single frames, lifted onto temporary Gaussians."""

    def __init__(self, folder: Path, iterations: int) -> None:
        """Read the artifacts in ``folder``, and lift the masks onto Gaussians of so many iterations."""
        frames, poses = (
            open_artifact(folder / "frames.zarr", FRAMES),
            open_artifact(folder / "poses.zarr", POSES),
        )
        self.segments = open_artifact(folder / "segments.zarr", SEGMENTS)
        keys = InstancesOptions(source="masks", iterations=iterations)
        kept, _ = kept_frames(frames, survey_of(folder))
        training, _ = split_views(frames, poses, kept)
        self.valid = frames.read("valid")
        self.rows = np.flatnonzero(kept & poses.read("registered"))[::FRAME_STEP]
        tracks = MovingTracks(self.segments)
        with TemporaryDirectory() as work:
            self.geometry = train_geometry(
                frames, poses, training, keys, Path(work) / "instances.zarr", "benchmark"
            )
        lifted = lift(self.geometry, self.segments, lambda _: self.valid, tracks.remove)
        assert lifted is not None, "the scene has masks"
        self.weight = lifted.weight
        self.whole = len(self.segments.facts["levels"]) - 1
        self.masks = lifted.select(self.segments.read("instances/level")[lifted.instance] == self.whole)
        truth = list(read_truth(folder / "recording", frames).all_labels())
        self.truth = {int(row): np.where(self.valid, truth[row], -1).astype(np.int32) for row in self.rows}

    def score(self, found: Iterator[Labels]) -> VideoScores:
        """Scores of the label maps of ``rows``."""
        step = (slice(None, None, PIXEL_STEP),) * 2
        return score_level(
            (self.truth[int(row)][step], labels[step]) for row, labels in zip(self.rows, found, strict=True)
        )

    def score_merged(self, values: dict[str, float]) -> VideoScores:
        """Scores of the masks merged with changed thresholds."""
        with ExitStack() as stack:
            for name, value in values.items():
                stack.enter_context(patch(CONSTANTS[name], value))
            return self.score(self.merged())

    def merged(self) -> Iterator[Labels]:
        """Labels of the merged masks."""
        thing, _ = find_things(self.masks, self.weight)
        held, geometry = beliefs(self.masks, thing), self.geometry
        for row in self.rows:
            view = geometry.views.camera, geometry.camera_to_world[row], geometry.settings
            shown = render_things(geometry.gaussians, [held], *view, self.valid.shape)
            yield np.where(self.valid, shown[0], -1)


# Decorator: training length of the Gaussians that masks are merged on, as ``iterations``.
iterations = click.option(
    "--iterations",
    default=InstancesOptions().iterations,
    show_default=True,
    help="Of the Gaussians that masks are merged on.",
)


def row_of(scene: str, change: str, scores: VideoScores, seconds: float | None) -> list[str]:
    """A row of the table."""
    numbers = (f"{scores.iou:.3f}", f"{scores.switches:.2f}", f"{scores.fragments:.2f}", f"{scores.held:.2f}")
    return [scene, change, str(scores.found), *numbers, "" if seconds is None else f"{seconds:.0f}"]


@command(__doc__)
@scene_folders
@iterations
@click.option("--change", "changes", multiple=True, type=click.Choice(list(CHANGES)), help="Only these.")
def main(folders: tuple[Path, ...], iterations: int, changes: tuple[str, ...]) -> None:
    """Measure and print the table."""
    rows = []
    for folder in folders:
        scene, name = Scene(folder, iterations), title_of(folder)
        masks = (scene.segments.row("labels", row)[scene.whole] for row in scene.rows)
        rows.append(row_of(name, "segments.zarr", scene.score(masks), None))
        for change in changes or CHANGES:
            scores, seconds = time_call(scene.score_merged, CHANGES[change])
            rows.append(row_of(name, change, scores, seconds))
            log(f"{name}, {change}: IoU {scores.iou:.3f}")
    print(markdown(COLUMNS, rows, words=2))


if __name__ == "__main__":
    main()
