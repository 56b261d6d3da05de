"""How well trained Gaussians render what they were not trained on, and what their training took.

Reads ``splats.zarr`` of each scene folder and prints a Markdown table.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/splats.zarr
    python benchmarks/training.py results/adt/scene{1,2,3,4,5} > benchmarks/training.md
"""

from pathlib import Path

import click
import numpy as np

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError

HEADER = (
    "| scene | origin | size | views | held out | iterations | Gaussians (at most) | PSNR [dB] | lowest, highest "
    "| SSIM | training [s] | peak memory [MB] | rasterizer |\n"
    "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |"
)


def row(scene: Path) -> str:
    """One row of the table."""
    splats = open_artifact(scene / "splats.zarr", SPLATS)
    facts, options, cost = splats.facts, splats.provenance["options"], splats.provenance
    psnr, ssim = splats.read("held_out/psnr"), splats.read("held_out/ssim")
    cells = [
        f"{scene.parent.name}/{scene.name}",
        splats.origin,
        f"{facts['camera']['width']}x{facts['camera']['height']}",
        facts["views"]["training"],
        len(psnr),
        f"{facts['iterations_done']:,}",
        f"{splats.shape('means')[0]:,} ({options['max_gaussians']:,})",
        f"{np.mean(psnr):.2f}",
        f"{psnr.min():.1f}, {psnr.max():.1f}",
        f"{np.mean(ssim):.3f}",
        f"{facts['training_s']:.0f}",
        f"{cost['peak_memory_mb']:.0f}",
        facts["rasterizer"],
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


@click.command(help=__doc__)
@click.argument("scenes", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(scenes: tuple[Path, ...]) -> None:
    try:
        rows = [row(scene) for scene in scenes]
    except UserError as error:
        raise SystemExit(str(error)) from error
    click.echo(
        "Training of Gaussians in colour: `benchmarks/training.py`. PSNR and SSIM of held-out frames.\n"
    )
    click.echo("\n".join([HEADER, *rows]))


if __name__ == "__main__":
    main()
