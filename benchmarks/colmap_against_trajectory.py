"""COLMAP's trajectory against the device's, on recordings that have one.

For each scene folder: takes its ``frames.zarr`` and ``poses.zarr`` (the device's trajectory), finds the poses
anew with COLMAP, aligns them by a similarity, and prints a Markdown table.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/poses.zarr
    python benchmarks/colmap_against_trajectory.py results/adt/scene{1,2,3,4,5} > benchmarks/colmap_against_trajectory.md
"""

import tempfile
import time
from pathlib import Path

import click
import numpy as np

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.errors import UserError
from egosplat.pipeline.config import defaults
from egosplat.poses.alignment import trajectory_error
from egosplat.poses.stage import run

HEADER = (
    "| scene | origin | frames | size | walk [m] | registered | reprojection [px] | ATE RMSE [m] "
    "| rotation RMSE [deg] | time [s] |\n| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def row(scene: Path) -> str:
    """One row of the table."""
    frames, truth = open_artifact(scene / "frames.zarr", FRAMES), open_artifact(scene / "poses.zarr", POSES)
    name = f"{scene.parent.name}/{scene.name}"
    count, height, width, _ = frames.shape("rgb")
    camera_to_world = truth.read("camera_to_world")
    walk = float(
        np.linalg.norm(np.diff(camera_to_world[truth.read("registered")][:, :3, 3], axis=0), axis=1).sum()
    )
    known = f"| {name} | {frames.origin} | {count} | {width}x{height} | {walk:.1f} "
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "poses.zarr"
        try:
            run(scene, scene / "frames.zarr", output, **defaults()["poses"] | {"method": "colmap"})
        except UserError as error:
            return f"{known}| {error} | | | | {time.perf_counter() - start:.0f} |"
        found = open_artifact(output, POSES)
        both = found.read("registered") & truth.read("registered")
        error = trajectory_error(found.read("camera_to_world")[both], camera_to_world[both])
        pixels = found.facts["notes"]["reprojection_error_px"]
        return (
            f"{known}| {found.read('registered').sum()} | {pixels:.2f} | {error['ate_rmse_m']:.4f} "
            f"| {error['rotation_rmse_deg']:.2f} | {time.perf_counter() - start:.0f} |"
        )


@click.command(help=__doc__)
@click.argument("scenes", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(scenes: tuple[Path, ...]) -> None:
    click.echo(
        "COLMAP against the device's trajectory: `benchmarks/colmap_against_trajectory.py`, two cores.\n"
    )
    click.echo(HEADER)
    for scene in scenes:
        click.echo(row(scene))


if __name__ == "__main__":
    main()
