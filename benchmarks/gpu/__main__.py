"""What a GPU computes and how fast: one command, about half an hour.

    pip install 'egosplat[cuda]'
    python -m benchmarks.gpu FOLDER > page.md

FOLDER is a working folder of 1 GB. An interrupted command goes on with the main job if it is run again. `--part` does a part alone.
"""

from collections.abc import Sequence
from pathlib import Path

import click
import torch

from benchmarks.common import command
from benchmarks.gpu import agreement, main_job, training
from egosplat.artifacts import provenance
from egosplat.rasterize.cuda import load_gsplat

PARTS = ("agreement", "main-job", "training")


@command(__doc__)
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--part", "parts", type=click.Choice(PARTS), multiple=True, default=PARTS, help="May be repeated."
)
def main(folder: Path, parts: Sequence[str]) -> None:
    """Print the page."""
    gsplat = load_gsplat()
    torch.zeros(1, device="cuda")  # so that the machine's line names the GPU
    click.echo(
        f"# A GPU\n\nBy `python -m benchmarks.gpu`, on {provenance.machine()}, gsplat {gsplat.__version__}."
    )
    if "agreement" in parts:
        click.echo(f"\n## Agreement with the reference in float64\n\n{agreement.table(torch.device('cuda'))}")
    if "main-job" in parts:
        main_job.run(folder)
        click.echo(f"\n## The main job\n\n{main_job.report(folder)}")
    if "training" in parts:
        # The frames of the main job: 512 x 512 pixels.
        scene = folder / main_job.SCENE
        click.echo(f"\n## Training\n\n{training.report(gsplat, scene, folder / 'training')}")


if __name__ == "__main__":
    main()
