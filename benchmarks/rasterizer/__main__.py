"""Speed of the rasterizer and of a training iteration.

    python -m benchmarks.rasterizer

Measures forward and backward pass of the C++ kernels (each variant that the processor runs) and of plain PyTorch on four scenes,
and a training iteration, in some minutes. Writes README.md and rasterizer.json in this folder. `--quick`
measures scene D alone in under a minute and fails where the kernels' lead over PyTorch is less than two thirds of the committed
one. `--gpu` compares with gsplat on a CUDA device.
"""

import json
import sys
from pathlib import Path

import click

from benchmarks.common import command
from benchmarks.rasterizer import comparison, gpu, table
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.rasterize.kernels import library

HERE = Path(__file__).resolve().parent
COMMITTED = HERE / "rasterizer.json"
# Share of the committed ratio that a quick run must reach.
LEAST = 2 / 3


def whole() -> None:
    """Measure everything and write both files."""
    results = comparison.everything()
    pages = {
        COMMITTED: json.dumps(results, indent=1) + "\n",
        HERE / "README.md": table.page(results, "python -m benchmarks.rasterizer"),
    }
    for path, text in pages.items():
        with atomic_file(path) as scratch:
            scratch.write_text(text)
        click.echo(f"wrote {path}")


def quick() -> list[str]:
    """Measure scene D and compare with the committed ratios; a line for each that falls short."""
    committed, variant = json.loads(COMMITTED.read_text())["raster"], library.variant()
    if not any(row["rasterizer"] == variant for row in committed):
        raise UserError(
            f"{COMMITTED} has no row of the variant {variant}: set EGOSPLAT_KERNEL to one that it has"
        )
    return shortfalls(comparison.quick(), committed, variant)


def shortfalls(rows: comparison.Rows, committed: comparison.Rows, variant: str) -> list[str]:
    """A line for each ratio on scene D that is less than ``LEAST`` of the committed one."""
    short = []
    for count in comparison.CHANNELS:
        found, wanted = (comparison.ratio(each, "D", count, variant) for each in (rows, committed))
        line = (
            f"scene D, {count} channels: {variant} is {found:.1f}x as fast as torch, committed {wanted:.1f}x"
        )
        click.echo(line)
        if found < LEAST * wanted:
            short.append(line)
    return short


@command(__doc__)
@click.option("--quick", "only_quick", is_flag=True, help="Compare scene D with the committed table.")
@click.option("--gpu", "on_gpu", is_flag=True, help="Compare with gsplat on a CUDA device.")
def main(only_quick: bool, on_gpu: bool) -> None:
    """Measure and write, or measure and compare."""
    if on_gpu:
        click.echo(gpu.table(comparison.CHANNELS))
    elif not only_quick:
        whole()
    elif short := quick():
        sys.exit("falls short by more than a third:\n" + "\n".join(short))


if __name__ == "__main__":
    main()
