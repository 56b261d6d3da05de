"""Memory of ``splats`` and ``transient`` on a long recording, without filming one.

    python -m benchmarks.long_recording FOLDER

FOLDER takes the recording, 0.1 GB at 3,600 frames. It is synthetic: each picture is one random color with a few random squares, which compresses to a few kilobytes. Memory
does not depend on what pictures show. Each stage runs in a process of its own.
"""

import resource
import time
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from unittest import mock

import click
import numpy as np

from benchmarks.common import command, markdown, output_of
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import Artifact, recorded_digest
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import FRAMES, MASKS, POSES
from egosplat.artifacts.writer import Writer, create
from egosplat.geometry import Camera

FRAME_NS = 100_000_000
POINTS = 20_000
STAGES = ("splats", "transient")


@command(__doc__)
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--frames", default=3600, show_default=True)
@click.option("--size", default=1408, show_default=True, help="Side of a picture [px].")
@click.option("--iterations", default=50, show_default=True)
@click.option("--stage", type=click.Choice(STAGES), help="Run this stage only, in this process.")
def main(folder: Path, frames: int, size: int, iterations: int, stage: str | None) -> None:
    """Write the recording, run both stages, print a table."""
    if not (folder / "poses.zarr").exists():
        write_recording(folder, frames, size)
    if stage:
        run(stage, folder, size, iterations)
        return
    rows = [row(one, folder, frames, size, iterations) for one in STAGES]
    click.echo(markdown(["stage", "frames", "side [px]", "iterations", "memory [GiB]", "time [s]"], rows))


def row(stage: str, folder: Path, frames: int, size: int, iterations: int) -> list[object]:
    """A row of the table: one stage, run in a process of its own."""
    started = time.perf_counter()
    words = ("--stage", stage, "--size", size, "--iterations", iterations)
    said = output_of("benchmarks.long_recording", folder.resolve(), *words)
    return [stage, frames, size, iterations, said.split()[-1], f"{time.perf_counter() - started:.0f}"]


def run(stage: str, folder: Path, size: int, iterations: int) -> None:
    """Run one stage at the full size of the pictures; prints the peak of its memory [GiB]."""
    keys = {"refine_poses": "off", "compensate_exposure": "off", "iterations": iterations}
    frames, poses, output = (folder / f"{name}.zarr" for name in ("frames", "poses", stage))
    if stage == "splats":
        from egosplat.splats.options import SplatsOptions
        from egosplat.splats.stage import run as train

        keys |= {"masking": "refined", "evaluate_every": iterations, "max_gaussians": POINTS}
        train(frames, poses, output, SplatsOptions(**keys), masks_path=folder / "masks.zarr")
    else:
        from egosplat.transient import stage as transient
        from egosplat.transient.options import TransientOptions

        keys["resolution"] = size
        # Predictions are written frame by frame; they take hours here and no memory.
        with mock.patch.object(transient, "_put_probability", _no_prediction):
            transient.run(frames, poses, output, TransientOptions(**keys))
    click.echo(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f}")


def _no_prediction(artifact: Writer, frames: Artifact, *rest: object) -> float:
    count, height, width, _ = frames.shape("rgb")
    artifact.allocate("probability", (count, height, width))
    for frame in range(count):
        artifact.put_row("probability", frame, np.zeros((height, width), np.float16))
    return 0.0


def write_recording(folder: Path, count: int, size: int) -> None:
    """Write frames, poses and masks of a camera that walks past a wall of points."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, camera = np.random.default_rng(0), Camera(size, size, 0.9 * size, 0.9 * size, size / 2, size / 2)
    train = np.arange(count) % 100 != 50
    facts = {"recording": "random pictures", "format": "plain", "upright": True, "notes": {}}
    facts["camera"] = asdict(camera)
    times = np.arange(count, dtype=np.int64) * FRAME_NS
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, 0, 3] = np.linspace(-2.0, 2.0, count)
    with created(folder, FRAMES) as artifact:
        artifact.allocate("rgb", (count, size, size, 3))
        for frame in range(count):
            artifact.put_row("rgb", frame, _picture(rng, size))
        arrays = {"timestamp_ns": times, "exposure_middle_ns": times, "train": train, "evaluation": ~train}
        arrays["valid"] = np.ones((size, size), bool)
        _put(artifact, FRAMES, arrays, count)
        artifact.facts = facts
    points = {"points/xyz": rng.uniform([-4, -2, 3], [4, 2, 5], (POINTS, 3))}
    points["points/rgb"] = rng.integers(256, size=(POINTS, 3), dtype=np.uint8)
    points |= {"camera_to_world": pose, "intrinsics": camera.matrix, "registered": np.ones(count, bool)}
    points["up"] = np.array([0.0, -1.0, 0.0])
    with created(folder, POSES, "frames") as artifact:
        _put(artifact, POSES, points, count)
        artifact.facts = facts
    with created(folder, MASKS, "frames") as artifact:
        artifact.allocate("refined", (count, size, size))
        for frame in range(count):
            artifact.put_row("refined", frame, np.zeros((size, size), bool))
        _put(artifact, MASKS, {}, 0)


def created(folder: Path, schema: Schema, *inputs: str) -> AbstractContextManager[Writer]:
    """The writer of an artifact."""
    digests = {f"{name}.zarr": recorded_digest(folder / f"{name}.zarr") for name in inputs}
    record = begin(schema.name, {}, "synthetic", digests, {})
    return create(folder / f"{schema.name}.zarr", schema, record)


def _put(artifact: Writer, schema: Schema, arrays: dict[str, np.ndarray], frames: int) -> None:
    """Write the arrays, and zeros for the others that the schema requires and that are not allocated by row."""
    for name, field in schema.fields.items():
        if name in arrays:
            artifact.put(name, arrays[name])
        elif not field.optional and not field.by_row:
            sizes = {"frame": frames, "point": POINTS, "height": 0, "width": 0}
            shape = tuple(dim if isinstance(dim, int) else sizes.get(dim, 0) for dim in field.dims)
            artifact.put(name, np.zeros(shape, field.dtype))


def _picture(rng: np.random.Generator, size: int) -> np.ndarray:
    picture = np.empty((size, size, 3), np.uint8)
    picture[:] = rng.integers(256, size=3)
    for row, column in rng.integers(size, size=(4, 2)):
        picture[row : row + size // 4, column : column + size // 4] = rng.integers(256, size=3)
    return picture


if __name__ == "__main__":
    main()
