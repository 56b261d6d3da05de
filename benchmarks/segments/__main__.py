"""Accuracy of whole segmented videos: SAM2 prompted once, and the segmenter without weights.

    python -m training.render_worlds data/held_out --worlds 20 --held-out --size 512 --clips 1 --frames 48 --step 0.2
    python -m benchmarks.segments data/held_out --limit 5 \
        --method "SAM2, initial frame" --method classical
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from benchmarks.common import command, markdown, time_call
from benchmarks.segments.video_scores import VideoScores, score_level
from benchmarks.small_sam2.worlds import LEVELS, world_folders
from egosplat.artifacts.provenance import peak_memory_mb
from egosplat.models.sam2_loader import load_sam2
from egosplat.progress import log
from egosplat.segments.classical import segment_video
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.tracker import Tracker
from egosplat.segments.video import Segmented, Video, finalize_instances
from training.small_models.worlds import NOTHING, RenderedWorld, read_world

# The compared methods, by their keys over the defaults.
METHODS: dict[str, dict[str, Any]] = {
    "SAM2, initial frame": {},
    "the same, 384 px": {"image_size": 384},
    "the same, every frame searched": {"lost_track_stride": 1},
    "classical": {},
}

# Heading and format of each measured number; see ``VideoScores``.
COLUMNS = {
    "instances": ("true instances", ".0f"),
    "found": ("found", ".0f"),
    "coverage": ("coverage", ".3f"),
    "iou": ("IoU over time", ".3f"),
    "switches": ("switches", ".3f"),
    "fragments": ("fragments", ".3f"),
    "held": ("held", ".3f"),
    "seconds": ("CPU-s a frame", ".2f"),
}


def options(method: str) -> SegmentsOptions:
    """The configuration's defaults with the method's own keys over them."""
    return SegmentsOptions(**{"prompting": "initial_frame"} | METHODS[method])


def segment(world: RenderedWorld, method: str, checkpoint: str) -> tuple[list[np.ndarray], float]:
    """(F,) final labels (3, H, W) of the first clip, and processor time of a frame [s]."""
    images, valid = world.rgb[0], world.subpart[0, 0] != NOTHING
    keys = options(method)

    def run() -> list[np.ndarray]:
        video = Video(len(images), lambda frame: np.array(images[frame]), lambda _: valid)
        if method == "classical":
            found = segment_video(video)
        else:
            sam2 = load_sam2("small", checkpoint, "auto", "auto", keys.image_size)
            found = Tracker(sam2, video, keys).run()
        return final_labels(found, keys.min_frames)

    labels, seconds = time_call(run)
    return labels, seconds / len(images)


def final_labels(segmented: Segmented, min_frames: int) -> list[np.ndarray]:
    """The labels that the stage writes."""
    table, _, _ = finalize_instances(segmented, min_frames)
    return [table[segmented.labels[frame]] for frame in range(len(segmented.labels))]


def score(world: RenderedWorld, labels: list[np.ndarray]) -> list[VideoScores]:
    """Scores of each level."""
    truth = [world.labels(world.subpart[0, frame]) for frame in range(len(labels))]
    pairs = list(zip(truth, labels, strict=True))
    return [score_level((true[level], found[level]) for true, found in pairs) for level in range(len(LEVELS))]


def measure(world: RenderedWorld, method: str, checkpoint: str) -> pd.DataFrame:
    """Scores and processor time of one world, a row for each level."""
    labels, seconds = segment(world, method, checkpoint)
    log(f"{method}: {seconds:.2f} CPU-s a frame")
    rows = [asdict(one) | {"seconds": seconds} for one in score(world, labels)]
    return pd.DataFrame(rows, index=LEVELS)


@command(__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--limit", default=5, help="number of worlds")
@click.option("--method", "methods", multiple=True, type=click.Choice(list(METHODS)), help="only these")
def main(worlds: Path, checkpoint: str, limit: int, methods: tuple[str, ...]) -> None:
    """Measure and print the table."""
    films = [read_world(folder) for folder in world_folders(worlds)[:limit]]
    rows = []
    for method in methods or METHODS:
        means = sum(measure(world, method, checkpoint) for world in films) / len(films)
        for level, mean in means.iterrows():
            rows.append([method, level, *(f"{mean[name]:{form}}" for name, (_, form) in COLUMNS.items())])
    frames, side = films[0].rgb.shape[1:3]
    click.echo(
        f"# Segmented videos\n\n`python -m benchmarks.segments`: {len(films)} held-out apartments, {frames} frames of {side} "
        f"px each; means over apartments. Peak memory {peak_memory_mb():.0f} MB.\n"
    )
    click.echo(markdown(["method", "level", *(title for title, _ in COLUMNS.values())], rows, words=2))


if __name__ == "__main__":
    main()
