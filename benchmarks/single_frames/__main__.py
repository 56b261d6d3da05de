"""How well masks of single frames show annotated things, by their size, under settings of the section `segments`.

python -m training.render_worlds data/curve --worlds 20 --held-out --size 512 --clips 1 --frames 4
python -m benchmarks.single_frames data/curve -s image_size=320,crops_per_side=1 -s image_size=512,crops_per_side=2
"""

from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from benchmarks.common import command, markdown, time_call
from benchmarks.small_sam2.worlds import LEAST_PIXELS, LEVELS, SIZES, size_class, world_folders
from egosplat.cli.flags import read_options
from egosplat.models.sam2_loader import load_sam2
from egosplat.progress import track
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.single_frames import join_frames, segment_frame
from egosplat.segments.video import Video
from training.small_models.worlds import NOTHING, RenderedWorld, read_world

Labels = NDArray[np.int32]


def options(setting: str) -> SegmentsOptions:
    """The configuration's defaults under a setting: `KEY=VALUE`, separated by commas.

    Raises:
        UserError: there is no such key, or it has a forbidden value.
    """
    return read_options(SegmentsOptions, "segments", {}, filter(None, setting.split(",")))


def first_frame(world: RenderedWorld) -> tuple[NDArray[np.uint8], NDArray[np.bool_], Labels]:
    """(H, W, 3) image, (H, W) valid pixels and (3, H, W) true labels."""
    valid = world.subpart[0, 0] != NOTHING
    return np.asarray(world.rgb[0, 0]), valid, world.labels(world.subpart[0, 0])


def best_ious(truth: Labels, found: Labels) -> Iterator[tuple[str, float]]:
    """Size class of each true thing of one level, and its IoU with the mask of any level that fits best.

    Args:
        truth: (H, W) labels; found: (3, H, W) labels, -1 for none. A mask counts as far as its label is drawn.
    """
    for value in np.unique(truth[truth >= 0]):
        mask = truth == value
        if mask.sum() >= LEAST_PIXELS:
            yield size_class(mask), max(_best_iou(mask, labels) for labels in found)


def _best_iou(mask: NDArray[np.bool_], labels: Labels) -> float:
    numbers, shared = np.unique(labels[mask & (labels >= 0)], return_counts=True)
    areas = np.array([(labels == number).sum() for number in numbers])
    return float(np.max(shared / (areas + mask.sum() - shared), initial=0.0))


def measure(worlds: list[RenderedWorld], setting: str, checkpoint: str) -> tuple[pd.DataFrame, float, float]:
    """A row for each true thing, and the masks and CPU-s of a frame."""
    keys, rows, masks, seconds = options(setting), [], 0, 0.0
    sam2 = load_sam2("small", checkpoint, "auto", "auto")
    for world in track(worlds, f"segmenting with {setting or 'the defaults'}", unit="world"):
        image, valid, truth = first_frame(world)
        video = Video(1, lambda _, one=image: one, lambda _, one=valid: one)
        masks_of_frame, taken = time_call(lambda one=video: segment_frame(sam2, one, 0, keys))
        found = join_frames([masks_of_frame], [0], 1, valid.shape)
        masks, seconds = masks + len(found.instances), seconds + taken
        rows += [
            (name, *one)
            for name, level in zip(LEVELS, truth, strict=True)
            for one in best_ious(level, found.labels[0])
        ]
    return pd.DataFrame(rows, columns=["level", "size", "iou"]), masks / len(worlds), seconds / len(worlds)


@command(__doc__)
@click.argument("worlds", type=click.Path(path_type=Path))
@click.option("--setting", "-s", "settings", multiple=True, default=[""], help="keys over the defaults")
@click.option("--checkpoint", default="small", help="of the small SAM2: `small` or a file")
@click.option("--limit", default=None, type=int, help="number of worlds")
def main(worlds: Path, settings: tuple[str, ...], checkpoint: str, limit: int | None) -> None:
    """Measure and print the table."""
    torch.set_num_threads(1)
    read = [read_world(folder) for folder in world_folders(worlds)[:limit]]
    rows = []
    for setting in settings:
        things, masks, seconds = measure(read, setting, checkpoint)
        means = things.groupby(["level", "size"])["iou"].mean()
        for level in reversed(LEVELS):
            cells = (f"{means.get((level, size), np.nan):.3f}" for size in SIZES)
            rows.append([setting or "defaults", level, *cells, f"{masks:.0f}", f"{seconds:.1f}"])
    click.echo(markdown(["setting", "level", *SIZES, "masks a frame", "CPU-s a frame"], rows, words=2))


if __name__ == "__main__":
    main()
