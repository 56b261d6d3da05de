"""How time and peak memory of segmenting a video grow with its frames and with the instances that are followed.

Each point is measured in a process of its own, on noise in which every mask is kept, so that as many instances are
followed as are asked for. SAM2's own predictor keeps every object's state of every frame; what is kept here is the frame
in which an object began and the last few.

    python benchmarks/segments_growth.py > benchmarks/segments_growth.md
    python benchmarks/segments_growth.py --sam2-config sam2.1_hiera_b+ --size 1408 --device cuda > ...
"""

import json
import os
import resource
import subprocess
import sys
import time

import click
import numpy as np
import torch

from egosplat.models.sam2_loader import load_sam2
from egosplat.progress import log
from egosplat.segments.options import LEVELS, MaskOptions, TrackOptions
from egosplat.segments.tracker import Tracker

POINTS = ((12, 60), (24, 60), (48, 60), (96, 60), (24, 15), (24, 120), (24, 240))
"""Frames, and instances of all levels together."""

KEEP_ALL = MaskOptions(
    points_per_side=24,
    pred_iou_thresh=-1.0,
    stability_score_thresh=-1.0,
    stability_score_offset=1.0,
    box_nms_thresh=1.0,
    nms_iou_thresh=1.0,
    nms_score_thresh=-1.0,
    nms_inner_thresh=1.0,
    min_area=0.0,
)


def measure(frames: int, instances: int, size: int, config: str, checkpoint: str, device: str) -> dict:
    """One point: seconds, instances that were followed, and MiB of peak memory, of the host and of a GPU."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(256, size=(size, size, 3), dtype=np.uint8) for _ in range(4)]
    sam2 = load_sam2(config, checkpoint, device, "auto")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    tracks = TrackOptions(
        key_frames=False,
        key_frame_stride=1,
        min_uncovered=0.0,
        new_cover_thresh=1.0,
        merge_iou=1.0,
        min_frames=1,
        max_instances=instances // len(LEVELS),
        # What is found at a level is followed for it, and in every frame: the most work that there can be.
        share_iou=1.01,
        absent_stride=1,
        batch=32,
    )
    began = time.perf_counter()
    tracker = Tracker(
        sam2, lambda frame: pictures[frame % 4], frames, np.ones((size, size), bool), KEEP_ALL, tracks
    )
    found = tracker.run()
    gpu = torch.cuda.max_memory_allocated() / 2**20 if torch.cuda.is_available() else 0.0
    return {
        "seconds": time.perf_counter() - began,
        "instances": len(found.instances),
        "before_mb": before,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "gpu_mb": gpu,
    }


def law(rows: list[tuple[int, dict]], name: str, terms: dict[str, np.ndarray]) -> str:
    """Least squares of a measure in the terms, and its largest error."""
    values = np.array([found[name] for _, found in rows])
    design = np.stack(list(terms.values()), axis=1)
    weights, *_ = np.linalg.lstsq(design / values[:, None], np.ones(len(values)), rcond=None)
    error = np.abs(design @ weights / values - 1).max()
    text = " + ".join(f"{weight:.3g} {term}".strip() for weight, term in zip(weights, terms, strict=True))
    return f"{text} (largest error {error:.0%})"


@click.command(help=__doc__)
@click.option("--size", default=512, show_default=True, help="Side of the pictures [px].")
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
    rows = []
    for frames, instances in POINTS:
        log(f"{frames} frames, {instances} instances")
        options = ["--size", size, "--sam2-config", sam2_config, "--sam2-checkpoint", sam2_checkpoint]
        command = [sys.executable, __file__, *options, "--device", device, "--point", frames, instances]
        # As the command line does: threads that spin while they wait slow each other down.
        environment = os.environ | {"OMP_WAIT_POLICY": "passive"}
        done = subprocess.run(
            list(map(str, command)), check=True, stdout=subprocess.PIPE, text=True, env=environment
        )
        rows.append((frames, json.loads(done.stdout.splitlines()[-1])))
    click.echo(
        f"# Segmenting {size} x {size} pictures with {sam2_config}, {torch.get_num_threads()} threads\n"
    )
    click.echo(
        "| frames | instances | time [s] | ms a frame and instance | peak memory [MiB] | of it the model [MiB] |"
    )
    click.echo("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for frames, found in rows:
        each = 1000 * found["seconds"] / frames / max(found["instances"], 1)
        click.echo(
            f"| {frames} | {found['instances']} | {found['seconds']:.1f} | {each:.1f} | {found['peak_mb']:.0f} "
            f"| {found['before_mb']:.0f} |"
        )
    f = np.array([frames for frames, _ in rows], float)
    n = np.array([found["instances"] for _, found in rows], float)
    click.echo(
        f"\nFitted for F frames and N instances: time [s] = {law(rows, 'seconds', {'F': f, 'F N': f * n})};"
    )
    memory = {"": np.ones_like(f), "F": f, "N": n}
    click.echo(f"peak memory [MiB] = {law(rows, 'peak_mb', memory)}.")


if __name__ == "__main__":
    main()
