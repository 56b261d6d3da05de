"""The heading of a page: its title, and below it why what it shows is not to be trusted."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from egosplat.page_text import HEADING_WIDTH, wrap_text

LINE = 0.2
"""Height of a line of 12 points, in inches."""


def draw_heading(figure: Figure, title: str, warnings: Sequence[str], fontsize: int = 12) -> None:
    """Write the title with the warnings below it; lines that are too long are broken, and the page grows by what is added.

    Args:
        figure: of its final size, but for what warnings need.
        title: one or more lines.
        warnings: notice and alarms, a line each.
        fontsize: in points.
    """
    heading = figure.suptitle("\n".join((title, *warnings)), fontsize=fontsize)
    wrap_text(heading, HEADING_WIDTH * figure.bbox.width)
    added = heading.get_text().count("\n") - title.count("\n")
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + LINE * fontsize / 12 * added)
