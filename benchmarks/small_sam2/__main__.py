"""How well the small SAM2 segments and follows on held-out worlds, beside the segmenter without weights.

python -m training.render_worlds data/held_out --worlds 20 --held-out --size 512 --clips 1 --frames 48 --step 0.2
python -m benchmarks.small_sam2 data/held_out > benchmarks/small_sam2/README.md
"""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import torch

HERE = Path(__file__).resolve().parent
from benchmarks.small_sam2.scores import LARGE, Scores, score_everything, score_film, score_points
from benchmarks.small_sam2.segmenters import ClassicalSegmenter, Segmenter, small_sam2
from benchmarks.small_sam2.worlds import LEVELS, SIZES, film, pictures, world_folders
from egosplat.errors import UserError
from egosplat.progress import track
from training.small_models.worlds import read_world

SEGMENTERS: dict[str, Callable[[str], Segmenter]] = {
    "small SAM2": small_sam2,
    "classical": lambda _: ClassicalSegmenter(),
}
"""What is compared, from the checkpoint."""


@dataclass(frozen=True)
class Task:
    """One world for one segmenter.

    Attributes:
        name: of the segmenter; checkpoint: of the small SAM2.
        folder: of the world; number: among the worlds, from which what is asked is drawn.
        stills: pictures that are looked at; tracks: masks that are followed.
    """

    name: str
    checkpoint: str
    folder: Path
    number: int
    stills: int
    tracks: int


def measure(task: Task) -> tuple[Scores, dict[str, float]]:
    """Scores, and the mean CPU seconds of a still, of everything in one, and of a track's frame."""
    torch.set_num_threads(1)
    segmenter, world = SEGMENTERS[task.name](task.checkpoint), read_world(task.folder)
    scores, seconds = Scores(), {"points": 0.0, "everything": 0.0, "track": 0.0}
    rng = np.random.default_rng([task.number, 7])
    seen = list(pictures(world, max(1, world.rgb.shape[1] // task.stills), rng))
    for picture in seen:
        seconds["points"] += _timed(score_points, segmenter, picture, scores) / len(seen)
        seconds["everything"] += _timed(score_everything, segmenter, picture, scores) / len(seen)
    clip = film(world, task.tracks, rng)
    seconds["track"] = _timed(score_film, segmenter, clip, scores) / clip.masks[:, :, 0, 0].size
    return scores, seconds


def together(results: list[tuple[Scores, dict[str, float]]]) -> tuple[Scores, dict[str, float]]:
    """All scores, and the mean of the seconds."""
    scores = Scores()
    for one, _ in results:
        scores.extend(one)
    names = results[0][1]
    return scores, {name: float(np.mean([seconds[name] for _, seconds in results])) for name in names}


def _timed(work: Callable[..., None], *arguments: object) -> float:
    start = time.process_time()
    work(*arguments)
    return time.process_time() - start


def table(results: dict[str, tuple[Scores, dict]]) -> str:
    """Markdown of all results."""
    names = list(results)
    lines = [f"| | masks | {' | '.join(names)} |", f"| --- | ---: |{' ---: |' * len(names)}"]

    def add(title: str, name: str, kinds: list[str]) -> None:
        means = [scores.mean(name, kinds) for scores, _ in results.values()]
        lines.append(f"| {title} | {means[0][1]} | {' | '.join(f'{mean:.3f}' for mean, _ in means)} |")

    for level in reversed(LEVELS):
        for title, kinds in {"> 1 %": LARGE, **{size: [size] for size in SIZES}}.items():
            add(f"best of three from a point, {level} {title}", f"best of three, {level}", kinds)
        add(f"mask of the level itself, {level} > 1 %", f"own level, {level}", LARGE)
    for title, kinds in {"> 1 %": LARGE, **{size: [size] for size in SIZES}}.items():
        add(f"everything found, wholes {title}", "everything", kinds)
    add("masks found in a picture", "masks found", ["all"])
    add("J, all tracks", "J", ["hidden for a while", "always visible or gone for good"])
    add("J, hidden for a while and back", "J", ["hidden for a while"])
    add("silent while hidden (share of frames)", "silent while hidden", ["all"])
    ranks = [scores.rank_correlation() for scores, _ in results.values()]
    lines.append(
        f"| rank correlation of predicted and true IoU | | {' | '.join(f'{r:.3f}' for r in ranks)} |"
    )
    for title, name in {"points": "points", "everything": "everything", "a track's frame": "track"}.items():
        times = [f"{1000 * seconds[name]:.0f}" for _, seconds in results.values()]
        lines.append(f"| CPU time [ms], {title} | | {' | '.join(times)} |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--stills", default=6, help="pictures a world")
@click.option("--tracks", default=6, help="masks followed a world")
@click.option("--limit", default=None, type=int, help="worlds, of those in the folder")
@click.option("--processes", default=2, help="worlds at a time")
def main(worlds: Path, checkpoint: str, stills: int, tracks: int, limit: int | None, processes: int) -> None:
    """Measure both and print the table."""
    try:
        folders = world_folders(worlds)[:limit]
        for make in SEGMENTERS.values():
            make(checkpoint)
    except UserError as error:
        raise SystemExit(str(error)) from error
    tasks = [
        Task(name, checkpoint, folder, number, stills, tracks)
        for name in SEGMENTERS
        for number, folder in enumerate(folders)
    ]
    with ProcessPoolExecutor(processes) as pool:
        measured = list(track(pool.map(measure, tasks), "measuring", total=len(tasks), unit="world"))
    results = {
        name: together([one for task, one in zip(tasks, measured, strict=True) if task.name == name])
        for name in SEGMENTERS
    }
    click.echo(
        f"The small SAM2 beside the segmenter without weights: `python -m benchmarks.small_sam2`. {len(folders)} held-out "
        f"worlds, {read_world(folders[0]).rgb.shape[2]} px, one thread. Mean IoU unless said otherwise; "
        "sizes are shares of the picture.\n"
    )
    click.echo(table(results))


if __name__ == "__main__":
    main()
