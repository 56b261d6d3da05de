"""Accuracy of the small SAM2 and of the segmenter without weights on held-out worlds: point prompts and tracking.

python -m training.render_worlds data/held_out --worlds 20 --held-out --size 512 --clips 1 --frames 48 --step 0.2
python -m benchmarks.small_sam2 data/held_out > benchmarks/small_sam2/README.md
"""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import pandas as pd
import torch

from benchmarks.common import command, markdown, time_call
from benchmarks.small_sam2.scores import Row, score_film, score_points
from benchmarks.small_sam2.segmenters import ClassicalSegmenter, Segmenter, small_sam2
from benchmarks.small_sam2.worlds import LEVELS, SIZES, film, stills, world_folders
from egosplat.progress import track
from training.small_models.worlds import read_world

# The compared segmenters, made from the checkpoint.
SEGMENTERS: dict[str, Callable[[str], Segmenter]] = {
    "small SAM2": small_sam2,
    "classical": lambda _: ClassicalSegmenter(),
}

# Rows of the table and their classes of size.
CLASSES = {"> 1 %": ("1-5 %", "> 5 %"), **{size: (size,) for size in SIZES}}


@dataclass(frozen=True)
class Task:
    """One world for one segmenter.

    Attributes:
        name: of the segmenter; checkpoint: of the small SAM2.
        folder: of the world; number: of the world, the seed of the drawn points and masks.
        stills, tracks: number of frames with point prompts, and of tracked masks.
    """

    name: str
    checkpoint: str
    folder: Path
    number: int
    stills: int
    tracks: int


def measure(task: Task) -> list[Row]:
    """Scores of one world, and processor time of a still's points and of a track's frame [ms]."""
    torch.set_num_threads(1)
    segmenter, world = SEGMENTERS[task.name](task.checkpoint), read_world(task.folder)
    rng = np.random.default_rng([task.number, 7])
    rows = []
    for still in stills(world, max(1, world.rgb.shape[1] // task.stills), rng):
        scored, seconds = time_call(score_points, segmenter, still)
        rows += [*scored, ("CPU time [ms], points", "all", 1000 * seconds)]
    clip = film(world, task.tracks, rng)
    scored, seconds = time_call(score_film, segmenter, clip)
    frames = clip.masks.shape[0] * clip.masks.shape[1]
    return [*rows, *scored, ("CPU time [ms], a frame of a track", "all", 1000 * seconds / frames)]


def table(results: pd.DataFrame) -> str:
    """Markdown of all rows: number of masks, and means of each segmenter."""
    lines: list[tuple[str, str, tuple[str, ...] | None]] = [
        (f"{score}, {level} {title}", f"{score}, {level}", kinds)
        for level in reversed(LEVELS)
        for score in ("best of three", "own level")
        for title, kinds in CLASSES.items()
    ]
    lines += [("J, all tracks", "J", None), ("J, hidden for a while and back", "J", ("returns",))]
    others = ("silent while hidden", "CPU time [ms], points", "CPU time [ms], a frame of a track")
    lines += [(name, name, None) for name in others]
    rows = []
    for title, name, kinds in lines:
        own = results[results["score"] == name]
        own = own if kinds is None else own[own["class"].isin(kinds)]
        means = [own[own["segmenter"] == one]["value"].mean() for one in SEGMENTERS]
        rows.append([title, len(own) // len(SEGMENTERS), *(f"{mean:.3f}" for mean in means)])
    return markdown(["", "results", *SEGMENTERS], rows)


@command(__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--stills", default=6, help="frames with point prompts of each world")
@click.option("--tracks", default=6, help="tracked masks of each world")
@click.option("--limit", default=None, type=int, help="number of worlds")
@click.option("--processes", default=2, help="worlds at a time")
def main(worlds: Path, checkpoint: str, stills: int, tracks: int, limit: int | None, processes: int) -> None:
    """Measure both segmenters and print the table."""
    folders = world_folders(worlds)[:limit]
    for make in SEGMENTERS.values():
        make(checkpoint)  # a wrong checkpoint is reported before the work starts
    tasks = [
        Task(name, checkpoint, folder, number, stills, tracks)
        for name in SEGMENTERS
        for number, folder in enumerate(folders)
    ]
    with ProcessPoolExecutor(processes) as pool:
        measured = list(track(pool.map(measure, tasks), "measuring", total=len(tasks), unit="world"))
    results = pd.DataFrame(
        [(task.name, *row) for task, rows in zip(tasks, measured, strict=True) for row in rows],
        columns=["segmenter", "score", "class", "value"],
    )
    click.echo(
        f"# The small SAM2\n\n`python -m benchmarks.small_sam2`: {len(folders)} held-out worlds, "
        f"{read_world(folders[0]).rgb.shape[2]} px, one thread. Mean IoU unless said otherwise; sizes are shares of the frame.\n"
    )
    click.echo(table(results))


if __name__ == "__main__":
    main()
