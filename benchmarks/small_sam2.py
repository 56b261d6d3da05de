"""How well the small SAM2 segments and follows on held-out worlds, beside the segmenter without weights.

python training/render_worlds.py data/held_out --worlds 20 --held-out --size 512 --clips 1 --frames 48 --step 0.2
python benchmarks/small_sam2.py data/held_out > benchmarks/small_sam2.md
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import torch

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "training"))

from segmentation_bench.scores import LARGE, Scores, score_everything, score_film, score_points
from segmentation_bench.segmenters import ClassicalSegmenter, Segmenter, small_sam2
from segmentation_bench.worlds import LEVELS, SIZES, film, pictures, read_worlds
from small_models.worlds import FilmedWorld

from egosplat.errors import UserError
from egosplat.progress import track


def measure(segmenter: Segmenter, worlds: list[FilmedWorld], stills: int, tracks: int) -> tuple[Scores, dict]:
    """All scores of a segmenter, and the mean seconds of a still, of everything in one, and of a track's frame."""
    scores, seconds = Scores(), {"points": 0.0, "everything": 0.0, "track": 0.0}
    frames = 0
    for number, world in enumerate(track(worlds, type(segmenter).__name__, unit="world")):
        rng = np.random.default_rng([number, 7])
        every = max(1, world.rgb.shape[1] // stills)
        for picture in pictures(world, every, rng):
            seconds["points"] += _timed(score_points, segmenter, picture, scores)
            seconds["everything"] += _timed(score_everything, segmenter, picture, scores)
            frames += 1
        clip = film(world, tracks, rng)
        seconds["track"] += _timed(score_film, segmenter, clip, scores) / clip.masks[:, :, 0, 0].size
    return scores, {
        "points": seconds["points"] / frames,
        "everything": seconds["everything"] / frames,
        "track": seconds["track"] / len(worlds),
    }


def _timed(work: Callable[..., None], *arguments: object) -> float:
    start = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - start


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
        lines.append(f"| time [ms], {title} | | {' | '.join(times)} |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--stills", default=6, help="pictures a world")
@click.option("--tracks", default=6, help="masks followed a world")
@click.option("--limit", default=None, type=int, help="worlds, of those in the folder")
def main(worlds: Path, checkpoint: str, stills: int, tracks: int, limit: int | None) -> None:
    """Measure both and print the table."""
    try:
        read = read_worlds(worlds)[:limit]
        segmenters = {"small SAM2": small_sam2(checkpoint), "classical": ClassicalSegmenter()}
    except UserError as error:
        raise SystemExit(str(error)) from error
    results = {name: measure(each, read, stills, tracks) for name, each in segmenters.items()}
    click.echo(
        f"The small SAM2 beside the segmenter without weights: `benchmarks/small_sam2.py`. {len(read)} held-out "
        f"worlds, {read[0].rgb.shape[2]} px, {torch.get_num_threads()} threads. Mean IoU unless said otherwise; "
        "sizes are shares of the picture.\n"
    )
    click.echo(table(results))


if __name__ == "__main__":
    main()
