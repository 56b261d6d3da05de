"""Speed of the rasterizer and of a training iteration.

    python -m benchmarks.rasterizer > benchmarks/rasterizer/README.md

Measures forward and backward pass of the C++ kernels (each variant that the processor runs) and of plain PyTorch on four scenes,
and a training iteration, in some minutes.
"""

import click

from benchmarks.common import command
from benchmarks.rasterizer import comparison, table


@command(__doc__)
def main() -> None:
    """Measure and print the page."""
    click.echo(table.page(comparison.everything()), nl=False)


if __name__ == "__main__":
    main()
