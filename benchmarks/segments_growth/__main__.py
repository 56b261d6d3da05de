"""Time and peak memory of segmenting a video against its frames and its tracked instances.

    python -m benchmarks.segments_growth > benchmarks/segments_growth/README.md
    python -m benchmarks.segments_growth --sam2-config sam2.1_hiera_b+ --size 1408 --device cuda > ...

Measures each point in a process of its own, on noise images in which every mask is kept, so that the number of tracked
instances is the requested one. SAM2's own predictor keeps each object's state of every frame; egosplat keeps the first frame of
an object and the last few.
"""

import json
import time

import click
import numpy as np
import torch

from benchmarks.common import command, markdown, output_of
from egosplat.artifacts.provenance import peak_memory_mb
from egosplat.models.sam2_loader import load_sam2
from egosplat.progress import log
from egosplat.segments.options import LEVELS, MaskFilter, SegmentsOptions
from egosplat.segments.tracker import Tracker
from egosplat.segments.video import Video

# Frames, and instances of all levels together.
POINTS = ((12, 60), (24, 60), (48, 60), (96, 60), (24, 15), (24, 120), (24, 240))

# Keys with which every mask is tracked.
KEEP_ALL = {
    "points_per_side": 24,
    "min_area": 0.0,
    "prompting": "initial_frame",
    "merge_iou": 1.0,
    "min_frames": 1,
    # In every frame: the largest possible work.
    "lost_track_stride": 1,
}
EVERY_MASK = MaskFilter(-1.0, -1.0, 1.0, -1.0, nms_iou_thresh=1.0, nms_inner_thresh=1.0, box_nms_thresh=1.0)


class KeepAll(SegmentsOptions):
    """Options that drop no mask."""

    @property
    def mask_filter(self) -> MaskFilter:
        """Keeps every mask."""
        return EVERY_MASK


COLUMNS = (
    "frames",
    "instances",
    "time [s]",
    "ms per frame and instance",
    "peak memory [MiB]",
    "of which the model [MiB]",
)


def measure(
    frames: int, instances: int, size: int, config: str, checkpoint: str, device: str
) -> dict[str, float]:
    """Measure one point: seconds, number of tracked instances, and peak memory of the host before and after [MiB]."""
    rng = np.random.default_rng(0)
    images = [rng.integers(256, size=(size, size, 3), dtype=np.uint8) for _ in range(4)]
    sam2 = load_sam2(config, checkpoint, device, "auto")
    before = peak_memory_mb()
    options = KeepAll(**KEEP_ALL, max_instances=instances // len(LEVELS))
    valid = np.ones((size, size), bool)
    began = time.perf_counter()
    found = Tracker(sam2, Video(frames, lambda frame: images[frame % 4], lambda _: valid), options).run()
    seconds = time.perf_counter() - began
    return {
        "seconds": seconds,
        "instances": len(found.instances),
        "before_mb": before,
        "peak_mb": peak_memory_mb(),
    }


def law(rows: list[dict[str, float]], name: str, terms: dict[str, np.ndarray]) -> str:
    """Least-squares fit of a measure in the terms, and its largest error."""
    values = np.array([found[name] for found in rows])
    design = np.stack(list(terms.values()), axis=1)
    weights, *_ = np.linalg.lstsq(design / values[:, None], np.ones(len(values)), rcond=None)
    error = np.abs(design @ weights / values - 1).max()
    text = " + ".join(f"{weight:.3g} {term}".strip() for weight, term in zip(weights, terms, strict=True))
    return f"{text} (largest error {error:.0%})"


def measure_apart(frames: int, instances: int, *options: object) -> dict[str, float]:
    """Measure one point in a process of its own."""
    log(f"{frames} frames, {instances} instances")
    # As for the command line: threads that spin while they wait slow each other down.
    output = output_of(
        "benchmarks.segments_growth", *options, "--point", frames, instances, OMP_WAIT_POLICY="passive"
    )
    return {"frames": frames, **json.loads(output.splitlines()[-1])}


@command(__doc__)
@click.option("--size", default=512, show_default=True, help="Side of the images [px].")
@click.option("--sam2-config", default="small", show_default=True)
@click.option("--sam2-checkpoint", default="small", show_default=True)
@click.option("--device", default="auto", show_default=True)
@click.option("--point", nargs=2, type=int, hidden=True)
def main(
    size: int, sam2_config: str, sam2_checkpoint: str, device: str, point: tuple[int, int] | None
) -> None:
    """Print the table; with a point, that measurement as JSON."""
    if point:
        click.echo(json.dumps(measure(*point, size, sam2_config, sam2_checkpoint, device)))
        return
    options = ["--size", size, "--sam2-config", sam2_config, "--sam2-checkpoint", sam2_checkpoint]
    found = [measure_apart(*one, *options, "--device", device) for one in POINTS]
    rows = []
    for one in found:
        each = 1000 * one["seconds"] / one["frames"] / max(one["instances"], 1)
        memory = [f"{one['peak_mb']:.0f}", f"{one['before_mb']:.0f}"]
        rows.append([one["frames"], one["instances"], f"{one['seconds']:.1f}", f"{each:.1f}", *memory])
    f, n = (np.array([one[name] for one in found], float) for name in ("frames", "instances"))
    click.echo(
        f"# Growth of segments\n\n`python -m benchmarks.segments_growth`: {size} x {size} px, SAM2 {sam2_config}, "
        f"{torch.get_num_threads()} threads.\n\n{markdown(COLUMNS, rows, words=0)}\n"
    )
    click.echo(
        f"Fitted for F frames and N instances: time [s] = {law(found, 'seconds', {'F': f, 'F N': f * n})};\n"
        f"peak memory [MiB] = {law(found, 'peak_mb', {'': np.ones_like(f), 'F': f, 'N': n})}."
    )


if __name__ == "__main__":
    main()
