"""How well whole videos are segmented: SAM2 prompted once or on key frames, and the segmenter without weights.

python -m training.render_worlds data/held_out --worlds 20 --held-out --size 512 --clips 1 --frames 48 --step 0.2
python -m benchmarks.segments data/held_out --limit 5 \
    --method "SAM2, key frames" --method "SAM2, initial frame" --method classical

What benchmarks/segments/README.md says of the table is written by hand.
"""

import resource
import time
from pathlib import Path
from typing import Any

import click
import numpy as np

HERE = Path(__file__).resolve().parent
from benchmarks.segments.video_scores import VideoScores, score_level
from benchmarks.small_sam2.worlds import LEVELS, read_worlds
from egosplat.errors import UserError
from egosplat.models.sam2_loader import load_sam2
from egosplat.pipeline.config import stage_keys
from egosplat.progress import log
from egosplat.segments.classical.video import segment_video
from egosplat.segments.instances import Segmented, settle
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.tracker import Tracker
from training.small_models.worlds import NOTHING, FilmedWorld

METHODS: dict[str, dict[str, Any]] = {
    "SAM2, initial frame": {"prompting": "initial_frame"},
    "SAM2, key frames": {},
    "the same, 384 px": {"image_size": 384},
    "the same, each level for itself": {"share_iou": 1.01},
    "the same, every frame searched": {"absent_stride": 1},
    "classical": {},
}
"""What is compared, and by which options it differs from the defaults."""

COLUMNS = ("instances", "found", "coverage", "iou", "switches", "fragments", "held")


def options(method: str) -> SegmentsOptions:
    """The configuration's defaults with the method's own keys over them."""
    keys = {name: key["default"] for name, key in stage_keys("segments").items()}
    return SegmentsOptions(**keys | {"prompting": "key_frames"} | METHODS[method])


def segment(world: FilmedWorld, method: str, checkpoint: str) -> tuple[list[np.ndarray], float]:
    """(F,) final labels (3, H, W) of the first clip, and CPU seconds a frame."""
    pictures, valid = world.rgb[0], world.subpart[0, 0] != NOTHING
    keys = options(method)
    start = time.process_time()
    if method == "classical":
        segmented = segment_video(lambda frame: np.asarray(pictures[frame]), len(pictures), valid)
    else:
        sam2 = load_sam2("small", checkpoint, "auto", "auto", keys.image_size)
        tracker = Tracker(sam2, lambda frame: np.array(pictures[frame]), len(pictures), valid, keys)
        segmented = tracker.run()
    labels = final_labels(segmented, keys.min_frames)
    return labels, (time.process_time() - start) / len(pictures)


def final_labels(segmented: Segmented, min_frames: int) -> list[np.ndarray]:
    """What the stage writes."""
    table = settle(segmented, min_frames).table
    return [table[segmented.labels[frame]] for frame in range(len(segmented.labels))]


def score(world: FilmedWorld, labels: list[np.ndarray]) -> list[VideoScores]:
    """Of each level."""
    truth = [world.labels(world.subpart[0, frame]) for frame in range(len(labels))]
    pairs = list(zip(truth, labels, strict=True))
    return [score_level((true[level], found[level]) for true, found in pairs) for level in range(len(LEVELS))]


@click.command(help=__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--limit", default=5, help="worlds, of those in the folder")
@click.option("--method", "methods", multiple=True, type=click.Choice(list(METHODS)), help="only these")
def main(worlds: Path, checkpoint: str, limit: int, methods: tuple[str, ...]) -> None:
    """Measure and print the table."""
    try:
        read = read_worlds(worlds)[:limit]
    except UserError as error:
        raise SystemExit(str(error)) from error
    rows = []
    for method in methods or METHODS:
        scores, seconds = [], []
        for world in read:
            labels, taken = segment(world, method, checkpoint)
            scores.append(score(world, labels))
            seconds.append(taken)
            log(f"{method}: {taken:.2f} CPU-s a frame")
        for level, name in enumerate(LEVELS):
            means = [np.mean([getattr(one[level], column) for one in scores]) for column in COLUMNS]
            cells = " | ".join(
                f"{mean:.0f}" if column in COLUMNS[:2] else f"{mean:.3f}"
                for mean, column in zip(means, COLUMNS, strict=True)
            )
            rows.append(f"| {method} | {name} | {cells} | {np.mean(seconds):.2f} |")
    frames = read[0].rgb.shape[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    click.echo(
        f"Segmented videos: `python -m benchmarks.segments`. {len(read)} held-out apartments, {frames} frames of "
        f"{read[0].rgb.shape[2]} px each; means over apartments. Peak memory {peak:.0f} MB.\n"
    )
    click.echo(
        "| method | level | true instances | found | coverage | IoU over time | switches | fragments | held | CPU-s a frame |"
    )
    click.echo("| --- | --- |" + " ---: |" * 8)
    click.echo("\n".join(rows))


if __name__ == "__main__":
    main()
