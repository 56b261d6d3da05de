"""Figures: matplotlib without a screen, headings, logarithmic axes, and writing to PNG."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
matplotlib.rcParams["text.parse_math"] = False  # a name may hold dollars

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from egosplat.files import atomic_file
from egosplat.page_text import HEADING_WIDTH, arrange_texts, wrap_text

__all__ = [
    "draw_heading",
    "inner_point",
    "label_log_axis",
    "middles_of_parts",
    "plt",
    "save_figure",
    "show",
]

DPI = 90

# Height of a line of 12 points [inches].
_LINE = 0.2


def draw_heading(figure: Figure, title: str, warnings: Sequence[str], fontsize: int = 12) -> None:
    """Write the title with the warnings below it. Long lines are wrapped, and the figure grows by the added lines.

    Args:
        figure: figure at its final size, except for the height of warnings.
        title: one or more lines.
        warnings: notices and alarms, one line each.
        fontsize: in points.
    """
    heading = figure.suptitle("\n".join((title, *warnings)), fontsize=fontsize)
    wrap_text(heading, HEADING_WIDTH * figure.bbox.width)
    added = heading.get_text().count("\n") - title.count("\n")
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LINE * fontsize / 12 * added)


def middles_of_parts(count: int, most: int) -> list[int]:
    """At most ``most`` indices below ``count``: the middle of each of as many equal parts."""
    parts = min(count, most)
    return [count * (2 * part + 1) // (2 * parts) for part in range(parts)]


def inner_point(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Column and row of the mask's pixel nearest to its median, which itself may lie outside of the mask."""
    rows, columns = np.nonzero(mask)
    nearest = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
    return int(columns[nearest]), int(rows[nearest])


def show(cell: Axes, picture: NDArray, title: str, fontsize: int = 9, **style: Any) -> AxesImage:
    """Draw an image below its title, without axes; ``style`` as for ``Axes.imshow``."""
    cell.set_title(title, fontsize=fontsize)
    cell.set_axis_off()
    return cell.imshow(picture, **style)


def label_log_axis(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers."""
    # Matplotlib's own labels are formulas, which are not rendered here: see text.parse_math above.
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def save_figure(figure: Figure, output: Path) -> None:
    """Write a figure as PNG and close it. The file is complete or absent.

    Long titles are wrapped first, and names are moved inside their images.
    """
    arrange_texts(figure)
    with atomic_file(output) as scratch:
        figure.savefig(scratch, dpi=DPI, format="png", metadata={"Software": "egosplat"})
    plt.close(figure)


def ground_axes(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors that span the plane perpendicular to ``up``.

    Args:
        up: (3,) float64 unit vector.

    Returns:
        (2, 3) float64; seen from above, the first points to the right of the page and the second to its top.
    """
    # The world axis least parallel to up gives the best-conditioned cross product.
    helper = np.eye(3)[np.argmin(np.abs(up))]
    right = np.cross(helper, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(up, right)])
