"""COLMAP's trajectory against the device's, on scenes whose recording has one.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/poses.zarr
    python -m benchmarks.colmap results/adt/scene{1,2,3,4,5} > benchmarks/colmap/README.md

Estimates the poses of each scene's `frames.zarr` with COLMAP, and aligns them by a similarity with its `poses.zarr`.
"""

import tempfile
import time
from pathlib import Path

import click
import numpy as np

from benchmarks.colmap.alignment import trajectory_error
from benchmarks.common import command, markdown, scene_folders
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.errors import UserError
from egosplat.pipeline.home import title_of
from egosplat.poses.options import PosesOptions
from egosplat.poses.stage import run

COLUMNS = (
    "scene",
    "origin",
    "frames",
    "size",
    "walk [m]",
    "registered",
    "reprojection [px]",
    "ATE RMSE [m]",
    "rotation RMSE [deg]",
    "time [s]",
)


def row(folder: Path) -> list[str]:
    """A scene's row; if COLMAP fails, the column ``registered`` has its error."""
    frames, truth = (
        open_artifact(folder / "frames.zarr", FRAMES),
        open_artifact(folder / "poses.zarr", POSES),
    )
    count, height, width, _ = frames.shape("rgb")
    places = truth.read("camera_to_world")[truth.read("registered")][:, :3, 3]
    walk = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    known = [title_of(folder), frames.origin, str(count), f"{width}x{height}", f"{walk:.1f}"]
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as work:
        output = Path(work) / "poses.zarr"
        try:
            run(folder, folder / "frames.zarr", output, PosesOptions(method="colmap"))
            found = _errors(open_artifact(output, POSES), truth)
        except UserError as error:
            found = [" ".join(str(error).split()), "", "", ""]
    return [*known, *found, f"{time.perf_counter() - start:.0f}"]


def _errors(found: Artifact, truth: Artifact) -> list[str]:
    """Registered frames, reprojection error, and errors of position and rotation."""
    registered = found.read("registered")
    both = registered & truth.read("registered")
    error = trajectory_error(found.read("camera_to_world")[both], truth.read("camera_to_world")[both])
    pixels = found.facts["notes"]["reprojection_error_px"]
    distances = [f"{error['ate_rmse_m']:.4f}", f"{error['rotation_rmse_deg']:.2f}"]
    return [str(registered.sum()), f"{pixels:.2f}", *distances]


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    rows = [row(folder) for folder in folders]
    click.echo("# COLMAP against the device's trajectory\n\nMade by `python -m benchmarks.colmap`.\n")
    click.echo(markdown(COLUMNS, rows, words=2))


if __name__ == "__main__":
    main()
