"""Held-out PSNR with exact and with wrong poses and exposures, with corrections off and on.

    S="results/corrections/exact results/corrections/poses results/corrections/exposure results/corrections/both"
    snakemake --cores 2 --configfile benchmarks/corrections/config.yaml -- \
        $(for s in $S; do echo $s/splats.zarr $s/variants/corrected/splats.zarr; done)
    python -m benchmarks.corrections $S

The first folder is the recording with exact poses and constant exposure; the others record the same walk.
"""

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.common import command, markdown, scene_folders
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, SPLATS, camera_poses


def row(folder: Path, exact: Path, variant: str) -> dict[str, object]:
    """The cells of a training by column."""
    splats = open_artifact(folder / variant / "splats.zarr", SPLATS)
    poses, truth = (open_artifact(one / "poses.zarr", POSES) for one in (folder, exact))
    error = pose_error(camera_poses(poses, splats), truth.read("camera_to_world"))
    given = splats.read("held_out/psnr_given") if splats.has("held_out/psnr_given") else np.full(1, np.nan)
    psnr, ssim = (splats.read(f"held_out/{name}").mean() for name in ("psnr", "ssim"))
    return {
        "recording": folder.name,
        "corrections": "on" if variant else "off",
        "PSNR": f"{psnr:.2f}",
        "without fit": "" if np.isnan(given).any() else f"{given.mean():.2f}",
        "SSIM": f"{ssim:.3f}",
        "brighter": f"{brightness(folder, exact, splats.read('held_out/frame')):+.2f}",
        "pose error": f"{error[0]:.1f} mm, {error[1]:.2f}°",
        "CPU-s": f"{splats.provenance['cpu_s']:.0f}",
        "iterations/s": f"{splats.facts['iteration'] / splats.facts['training_s']:.1f}",
    }


def pose_error(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> tuple[float, float]:
    """RMS distance [mm] and angle [deg] from the true poses, after the best rigid motion of all cameras together."""
    turns = np.einsum("nij,nkj->nik", truth[:, :3, :3], poses[:, :3, :3])
    turn = Rotation.from_matrix(turns).mean().as_matrix()
    center, true_center = poses[:, :3, 3], truth[:, :3, 3]
    off = (center - center.mean(axis=0)) @ turn.T - (true_center - true_center.mean(axis=0))
    rest = Rotation.from_matrix(np.einsum("ij,njk,nlk->nil", turn, poses[:, :3, :3], truth[:, :3, :3]))
    return 1e3 * _rms(np.linalg.norm(off, axis=1)), float(np.degrees(_rms(rest.magnitude())))


def brightness(folder: Path, exact: Path, rows: NDArray[np.int64]) -> float:
    """By how much the held-out frames are brighter than in the exact recording [dB], which raises errors as much."""
    own, other = (open_artifact(one / "frames.zarr", FRAMES) for one in (folder, exact))
    return float(np.mean([20.0 * np.log10(_gain(own, other, int(frame))) for frame in rows]))


def _gain(own: Artifact, other: Artifact, frame: int) -> float:
    valid = own.read("valid")
    bright, reference = (one.row("rgb", frame)[valid].astype(np.float64) for one in (own, other))
    return float((bright * reference).sum() / np.square(reference).sum())


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(values).mean()))


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    rows = [row(folder, folders[0], variant) for folder in folders for variant in ("", "variants/corrected")]
    click.echo(markdown(list(rows[0]), [list(one.values()) for one in rows], words=2))


if __name__ == "__main__":
    main()
