"""Quality of trained Gaussians on held-out frames, and the cost of their training.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/splats.zarr
    python -m benchmarks.training results/adt/scene{1,2,3,4,5} > benchmarks/training/README.md

Reads `splats.zarr` of each scene.
"""

from pathlib import Path

import click
import numpy as np

from benchmarks.common import command, markdown, scene_folders
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SPLATS
from egosplat.pipeline.home import title_of


def row(folder: Path) -> dict[str, object]:
    """A scene's cells by column."""
    splats = open_artifact(folder / "splats.zarr", SPLATS)
    facts, options = splats.facts, splats.provenance["options"]
    psnr, ssim = splats.read("held_out/psnr"), splats.read("held_out/ssim")
    return {
        "scene": title_of(folder),
        "origin": splats.origin,
        "size": f"{facts['camera']['width']}x{facts['camera']['height']}",
        "views": facts["views"]["training"],
        "held out": len(psnr),
        "iterations": f"{facts['iteration']:,}",
        "Gaussians (at most)": f"{splats.shape('means')[0]:,} ({options['max_gaussians']:,})",
        "PSNR [dB]": f"{np.mean(psnr):.2f}",
        "lowest, highest": f"{psnr.min():.1f}, {psnr.max():.1f}",
        "SSIM": f"{np.mean(ssim):.3f}",
        "training [s]": f"{facts['training_s']:.0f}",
        "peak memory [MB]": f"{splats.provenance['peak_memory_mb']:.0f}",
        "rasterizer": facts["rasterizer"],
    }


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    rows = [row(folder) for folder in folders]
    click.echo(
        "# Training of Gaussians\n\n`python -m benchmarks.training`: PSNR and SSIM of held-out frames.\n"
    )
    click.echo(markdown(list(rows[0]), [list(one.values()) for one in rows], words=3))


if __name__ == "__main__":
    main()
