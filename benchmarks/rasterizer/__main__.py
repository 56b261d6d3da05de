"""How fast the rasterizer and a training iteration are.

Measures forward and backward pass of the C++ kernels (each variant that this processor runs), of plain PyTorch and of
Numba on four scenes, their share of the machine's peak, a training iteration by phases, and peak memory; about
ten minutes, best on a machine that does nothing else:

    python -m benchmarks.rasterizer

writes rasterizer.md and rasterizer.json beside this file. With --quick, in under a minute: measures scene D alone, and
fails where the kernels' lead over torch or numba is less than two thirds of that in rasterizer.json.
"""

import json
import sys
from pathlib import Path
from typing import Any

import click

from benchmarks.rasterizer import comparison
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.kernels import library

HERE = Path(__file__).resolve().parent
COMMITTED = HERE / "rasterizer.json"
LEAST = 2 / 3
"""Share of the committed ratio that a quick run must reach."""


def whole() -> None:
    """Measure everything and write both files."""
    # Only here: training takes seconds to import, in each of the processes that measure.
    from benchmarks.rasterizer import measure, table

    results = measure.everything()
    for path, text in (
        (COMMITTED, json.dumps(results, indent=1) + "\n"),
        (HERE / "README.md", table.markdown(results, "python -m benchmarks.rasterizer")),
    ):
        with atomic_file(path) as scratch:
            scratch.write_text(text)
        click.echo(f"wrote {path}")


def quick() -> list[str]:
    """Measure scene D and compare with the committed ratios; a line for each that falls short."""
    if not COMMITTED.is_file():
        raise UserError(f"{COMMITTED} is missing: make it with python -m benchmarks.rasterizer")
    committed, variant = json.loads(COMMITTED.read_text())["raster"], library.variant()
    if not any(row["rasterizer"] == variant for row in committed):
        raise UserError(
            f"{COMMITTED} has no row of the variant {variant}: set EGOSPLAT_KERNEL to one that it has"
        )
    return shortfalls(comparison.quick(), committed, variant)


def shortfalls(rows: list[dict[str, Any]], committed: list[dict[str, Any]], variant: str) -> list[str]:
    """A line for each ratio on scene D that is less than ``LEAST`` of the committed one."""
    short = []
    for count in comparison.CHANNELS:
        for peer in comparison.PEERS:
            case = ("D", count, variant, peer)
            found, wanted = comparison.ratio(rows, *case), comparison.ratio(committed, *case)
            line = f"scene D, {count} channels: {variant} is {found:.1f}x as fast as {peer}, committed {wanted:.1f}x"
            click.echo(line)
            if found < LEAST * wanted:
                short.append(line)
    return short


@click.command(help=__doc__)
@click.option("--quick", "only_quick", is_flag=True, help="Compare scene D with the committed table.")
@click.option("--gpu", "on_gpu", is_flag=True, help="Compare with gsplat on a CUDA device.")
def main(only_quick: bool, on_gpu: bool) -> None:
    try:
        if on_gpu:
            from benchmarks.rasterizer import gpu

            click.echo(gpu.table(gpu.compare(comparison.CHANNELS)))
        elif only_quick:
            if short := quick():
                sys.exit("falls short by more than a third:\n" + "\n".join(short))
        else:
            whole()
    except UserError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
