"""True tracks, cut and swapped at random, and what merging them in 3D repairs.

    snakemake --cores 2 results/adt/scene{1,2}/poses.zarr
    python -m benchmarks.instances.broken_tracks results/adt/scene{1,2}
    python -m benchmarks.instances.broken_tracks --queries results/adt/scene1    (needs a finished scene)

Every frame of a synthetic recording is annotated. These instances become `segments.zarr` with one level, and the stage
`instances` merges them as it does tracks (`instances.source` both). Frames are scored as in ``benchmarks/instances``.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import command, markdown, scene_folders, survey_of, time_call
from benchmarks.instances.__main__ import FRAME_STEP, PIXEL_STEP, iterations
from benchmarks.instances.video_scores import VideoScores, score_level
from benchmarks.scores import format_score
from benchmarks.transient.truth import Truth, read_truth
from benchmarks.true_instances.__main__ import PRESETS, run, score, write_instances
from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, POSES, SEGMENTS
from egosplat.artifacts.writer import create
from egosplat.pipeline import config as configuration
from egosplat.pipeline.home import title_of
from egosplat.progress import log, track

# Frames after which every track gets a new name, share of frames in which two visible tracks swap their names, and
# the seed of these swaps.
CUT_EVERY, SWAPPED, SEED = 20, 0.1, 0

COLUMNS = ("scene", "tracks", "instances", "IoU over time", "switches", "fragments", "held", "CPU-s")
QUERIED = ("accuracy", "mIoU")

Labels = NDArray[np.int32]


def break_tracks(truth: list[Labels], count: int) -> list[Labels]:
    """Cut and swap tracks.

    Args:
        truth: (H, W) true instance of each pixel of each frame, -1 for none.
        count: number of true instances.

    Returns:
        Labels like the given ones; instance i of piece p is ``p * count + i``.
    """
    rng = np.random.default_rng(SEED)
    found = []
    for frame, labels in enumerate(truth):
        names = np.append(np.arange(count), -1).astype(np.int32)
        shown = np.unique(labels[labels >= 0])
        if rng.uniform() < SWAPPED and len(shown) > 1:
            one, other = rng.choice(shown, 2, replace=False)
            names[[one, other]] = other, one
        names[:-1] += frame // CUT_EVERY * count
        found.append(names[labels])
    return found


def write_segments(output: Path, frames: Artifact, labels: list[Labels], moving: NDArray[np.bool_]) -> None:
    """Write tracks as ``segments.zarr`` with one level; ``moving``: (N,) of the N tracks."""
    count, one = len(moving), np.ones(len(moving), np.float32)
    with create(output, SEGMENTS, provenance.begin_from("segments", {}, [frames])) as artifact:
        artifact.allocate("labels", (len(labels), 1, *labels[0].shape))
        for frame, found in enumerate(labels):
            artifact.put_row("labels", frame, found[None])
        artifact.put("instances/level", np.zeros(count, np.int8))
        artifact.put("instances/predicted_iou", one)
        artifact.put("instances/stability", one)
        artifact.put("instances/first_frame", np.zeros(count, np.int64))
        artifact.put("instances/moving", moving)
        artifact.facts = {"levels": ["whole"], "segmenter": "truth"}


def renamed(tracks: Labels, things: Labels) -> Labels:
    """Outlines of tracks (H, W) with the name of the thing that most of their pixels show; -1 where that is none."""
    found = np.full_like(tracks, -1)
    for name in np.unique(tracks[tracks >= 0]):
        mask = tracks == name
        shown, pixels = np.unique(things[mask], return_counts=True)
        found[mask] = shown[pixels.argmax()]
    return found


class Scene:
    """A scene with its true instances, before and after they were broken."""

    def __init__(self, folder: Path) -> None:
        """Read the truth of the scene in ``folder``."""
        self.folder = folder
        self.frames = open_artifact(folder / "frames.zarr", FRAMES)
        self.truth: Truth = read_truth(folder / "recording", self.frames)
        valid = self.frames.read("valid")
        annotated = track(list(self.truth.all_labels()), "reading annotations")
        self.true = [np.where(valid, labels, -1).astype(np.int32) for labels in annotated]
        self.broken = break_tracks(self.true, len(self.truth.names))
        kept, _ = kept_frames(self.frames, survey_of(folder))
        registered = open_artifact(folder / "poses.zarr", POSES).read("registered")
        self.rows = np.flatnonzero(kept & registered)[::FRAME_STEP]

    def merge(self, tracks: list[Labels], source: str, iterations: int, work: Path) -> list[Labels]:
        """Labels of the stage ``instances`` for these tracks, which it writes into ``work`` with its input."""
        pieces = -(-len(tracks) // CUT_EVERY) if tracks is self.broken else 1
        write_segments(work / "segments.zarr", self.frames, tracks, np.tile(self.truth.moves, pieces))
        run(
            "instances",
            configuration.resolve({"instances": {"source": source, "iterations": iterations}}, PRESETS),
            **{name: self.folder / f"{name}.zarr" for name in ("frames", "poses")},
            segments=work / "segments.zarr",
            survey=survey_of(self.folder),
            output=work / "instances.zarr",
        )
        found = open_artifact(work / "instances.zarr", INSTANCES)
        return [found.row("labels", frame)[0] for frame in range(len(tracks))]

    def score(self, found: list[Labels]) -> VideoScores:
        """Scores of label maps of all frames."""
        step = (slice(None, None, PIXEL_STEP),) * 2
        return score_level((self.true[row][step], found[row][step]) for row in self.rows)

    def query(self, work: Path) -> list[str]:
        """Accuracy and mIoU of the queries with the instances in ``work``."""
        config = configuration.resolve({}, PRESETS)
        frames, instances = self.folder / "frames.zarr", work / "instances.zarr"
        run("view_features", config, frames=frames, instances=instances, output=work / "view_features.zarr")
        scored = score(self.folder, work, "average")
        return [format_score(scored.cell(name, "all")) for name in ("accuracy", "mean_iou")]


def rows_of(folder: Path, queries: bool, iterations: int) -> Iterator[list[object]]:
    """The table's rows of a scene."""
    scene = Scene(folder)
    cases = {"true": (scene.true, "tracks"), "true, merged in 3D": (scene.true, "both")}
    cases |= {"broken": (scene.broken, "tracks"), "broken, merged in 3D": (scene.broken, "both")}
    for name, (tracks, source) in cases.items():
        with TemporaryDirectory() as work:
            found, seconds = time_call(partial(scene.merge, tracks, source, iterations, Path(work)))
            asked = scene.query(Path(work)) if queries else []
        yield [*cells(scene, name, found), f"{seconds:.0f}", *asked]
        if source == "both":
            outlined = [renamed(*both) for both in zip(tracks, found, strict=True)]
            with TemporaryDirectory() as work:
                count = 1 + max(int(labels.max()) for labels in outlined)
                write_instances(Path(work) / "instances.zarr", scene.frames, outlined, np.zeros(count, bool))
                asked = scene.query(Path(work)) if queries else []
            yield [*cells(scene, f"{name}, outlines of the tracks", outlined), "", *asked]


def cells(scene: Scene, name: str, found: list[Labels]) -> list[str]:
    """Name and scores of label maps of all frames."""
    one = scene.score(found)
    log(f"{scene.folder}, {name}: IoU {one.iou:.3f}")
    numbers = (f"{one.iou:.3f}", f"{one.switches:.2f}", f"{one.fragments:.2f}", f"{one.held:.2f}")
    return [title_of(scene.folder), name, str(one.found), *numbers]


@command(__doc__)
@scene_folders
@click.option("--queries", is_flag=True, help="Ask the scene's queries, too.")
@iterations
def main(folders: tuple[Path, ...], queries: bool, iterations: int) -> None:
    """Print the table."""
    rows = [row for folder in folders for row in rows_of(folder, queries, iterations)]
    print(markdown(COLUMNS + (QUERIED if queries else ()), rows, words=2))


if __name__ == "__main__":
    main()
