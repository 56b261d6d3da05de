"""The heading of a page: its title, and below it why what it shows is not to be trusted."""

from collections.abc import Sequence
from textwrap import wrap

from matplotlib.figure import Figure

LETTERS_PER_INCH = 10
"""Of text of 12 points."""

LINE = 0.2
"""Height of a line of 12 points, in inches."""


def draw_heading(figure: Figure, title: str, warnings: Sequence[str], fontsize: int = 12) -> None:
    """Write the title with the warnings below it; lines that are too long are broken, and the page grows by them.

    Args:
        figure: of its final size, but for what warnings need.
        title: one or more lines.
        warnings: notice and alarms, a line each.
        fontsize: in points.
    """
    width, height = figure.get_size_inches()
    letters, own = int(width * LETTERS_PER_INCH * 12 / fontsize), title.split("\n")
    lines = [part for line in (*own, *warnings) for part in wrap(line, letters)]
    figure.suptitle("\n".join(lines), fontsize=fontsize)
    figure.set_size_inches(width, height + LINE * fontsize / 12 * (len(lines) - len(own)))
