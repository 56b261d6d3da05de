"""Figures: matplotlib without a screen, headings, names on images, answers over views, and writing to PNG.

Titles are wrapped and names are moved when a figure is written: sizes of texts and images are known only after its layout.
"""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
matplotlib.rcParams["text.parse_math"] = False  # a name may hold dollars

from adjustText import adjust_text
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.font_manager import get_font_names
from matplotlib.image import AxesImage
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from matplotlib.transforms import Bbox

from egosplat.files import atomic_file

# Letters that Matplotlib's own font lacks are drawn with these where the machine has them, else as boxes: without a warning.
_FONTS = [name for name in get_font_names() if name.startswith(("Noto Sans CJK", "WenQuanYi"))]
matplotlib.rcParams["font.family"] = ["DejaVu Sans", *_FONTS]
warnings.filterwarnings("ignore", "Glyph .* missing from font")

DPI = 90

# A third of the time of zlib's default, 6, for files that are 1 to 5 % larger.
_COMPRESSION = {"compress_level": 4}

# Height of a line of 12 points [inches].
_LINE = 0.2

# Maximum width of a heading, as a share of the page's width.
HEADING_WIDTH = 0.98

# Group id of texts that name something in an image, and their frame.
NAME = "name"
_BOX = {"facecolor": "black", "alpha": 0.55, "pad": 1, "edgecolor": "none"}

# Width and height that a name claims for itself, and steps in which names move apart.
_ROOM = (1.15, 1.3)
_STEPS = 60

# Brightness of pixels outside an answer's mask, and opacity of the heat map.
DIMMED, HEAT = 0.35, 0.65

# Word, marker and color of a hit and of a miss.
HIT, MISS = ("hit", "o", "forestgreen"), ("miss", "X", "red")


def draw_heading(figure: Figure, title: str, warnings: Sequence[str], fontsize: int = 12) -> None:
    """Write the title with the warnings, a line each, below it; long lines are wrapped, and the figure grows by the added lines."""
    heading = figure.suptitle("\n".join((title, *warnings)), fontsize=fontsize)
    wrap_text(heading, HEADING_WIDTH * figure.bbox.width)
    added = heading.get_text().count("\n") - title.count("\n")
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LINE * fontsize / 12 * added)


def split_page(page: FigureBase, rows: int, columns: int, **ratios: Any) -> list[SubFigure]:
    """Split a page into parts, row by row; ``ratios`` as for ``FigureBase.subfigures``."""
    return [*page.subfigures(rows, columns, squeeze=False, **ratios).flat]


def empty_grid(page: FigureBase, rows: int, columns: int, **ratios: Any) -> NDArray[Any]:
    """(rows, columns) places for images, without axes; ``ratios`` as for ``FigureBase.subplots``."""
    grid = page.subplots(rows, columns, squeeze=False, **ratios)
    for axes in grid.flat:
        hide_axes(axes)
    return grid


def hide_axes(axes: Axes) -> None:
    """Leave an image's ticks out; Matplotlib would still lay them out each time that it places a title."""
    axes.set_axis_off()
    axes.xaxis.set_visible(False)
    axes.yaxis.set_visible(False)


def show(cell: Axes, picture: NDArray, title: str, fontsize: int = 9, **style: Any) -> AxesImage:
    """Draw an image below its title, without axes; ``style`` as for ``Axes.imshow``."""
    cell.set_title(title, fontsize=fontsize)
    hide_axes(cell)
    return cell.imshow(picture, **style)


def label_log_axis(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers."""
    # Matplotlib's own labels are formulas, which are not rendered here: see text.parse_math above.
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def draw_heat(axes: Axes, picture: NDArray[np.float32], relevancy: NDArray[np.float32]) -> None:
    """Draw an (H, W) relevancy in 0..1 over the (H, W, 3) view in 0..1, shown in gray."""
    axes.imshow(picture.mean(axis=-1), cmap="gray", vmin=0.0, vmax=1.0)
    axes.imshow(relevancy, cmap="turbo", vmin=0.0, vmax=1.0, alpha=HEAT)


def draw_mask(axes: Axes, picture: NDArray[np.float32], mask: NDArray[np.bool_]) -> None:
    """Draw the (H, W, 3) view in 0..1, dimmed outside the (H, W) mask."""
    axes.imshow(np.where(mask[..., None], picture, DIMMED * picture))


def draw_outline(axes: Axes, mask: NDArray[np.bool_]) -> None:
    """Draw the outline of an (H, W) mask in white on black."""
    if mask.any() and not mask.all():
        axes.contour(mask, levels=[0.5], colors="black", linewidths=1.8)
        axes.contour(mask, levels=[0.5], colors="white", linewidths=0.9)


def add_name(axes: Axes, u: float, v: float, text: str, **style: Any) -> None:
    """Write a name at column u and row v of an image; ``arrange_texts`` may move or drop it. ``style`` as for ``Axes.text``."""
    usual = {"color": "white", "fontsize": 7, "ha": "center", "va": "center", "bbox": _BOX}
    axes.text(u, v, text, gid=NAME, in_layout=False, **usual | style)


def arrange_texts(figure: Figure) -> None:
    """Wrap titles to the width of their axes and headings to that of their page, then move names into the image and apart.

    A name for which there is no room is dropped, the later one first.
    """
    named = [axes for axes in figure.get_axes() if any(text.get_gid() == NAME for text in axes.texts)]
    _lay_out(figure, named)
    wrapped = [wrap_text(text, room) for text, room in _titles(figure)]
    if any(wrapped) and named:
        _lay_out(figure, named)
    for axes in named:
        _place_names(axes)


def _lay_out(figure: Figure, named: Sequence[Axes]) -> None:
    """Find the places of the axes; where names are placed inside images, those of the images, too."""
    if named:
        figure.draw_without_rendering()
    elif engine := figure.get_layout_engine():
        engine.execute(figure)


def _titles(figure: Figure) -> Iterator[tuple[Text, float]]:
    """Headings and titles, each with its maximum width [pixels]."""
    for page in _pages(figure):
        for text in page.texts:
            yield text, HEADING_WIDTH * page.bbox.width
    for axes in figure.get_axes():
        yield axes.title, axes.get_position(original=True).width * axes.figure.bbox.width


def _pages(page: FigureBase) -> Iterator[FigureBase]:
    yield page
    for part in page.subfigs:
        yield from _pages(part)


def wrap_text(text: Text, room: float) -> bool:
    """Break lines wider than ``room`` [pixels]; return whether there was one."""
    words = text.get_text()
    width = text.get_window_extent().width
    if width <= room:
        return False
    longest = max(map(len, words.split("\n")))
    letters = max(1, int(longest * room / width))
    text.set_text(
        "\n".join(
            fill(line, letters, break_long_words=False, break_on_hyphens=False) for line in words.split("\n")
        )
    )
    return True


def _place_names(axes: Axes) -> None:
    """Move the names of an image inside it and apart; drop what still covers an earlier name."""
    inside = axes.get_window_extent()
    names = [text for text in axes.texts if text.get_gid() == NAME]
    fitting = [name for name in names if name.get_window_extent().width <= inside.width]
    for name in set(names) - set(fitting):
        name.remove()
    # A name may stay on its own place, and no lines lead there that could cross.
    free = {"avoid_self": False, "prevent_crossings": False}
    # It would draw the page for each image, to know sizes that are known here.
    vars(axes.figure)["draw_without_rendering"] = lambda: None
    adjust_text(fitting, ax=axes, expand=_ROOM, iter_lim=_STEPS, **free)
    del vars(axes.figure)["draw_without_rendering"]
    kept: list[Bbox] = []
    for name in fitting:
        box = name.get_window_extent()
        if box.count_overlaps(kept):
            name.remove()
        else:
            kept.append(box)


def save_figure(figure: Figure, output: Path) -> None:
    """Arrange the texts of a figure, write it as PNG, complete or not at all, and close it."""
    # The size of a text is not quite proportional to the resolution.
    figure.set_dpi(DPI)
    arrange_texts(figure)
    with atomic_file(output) as scratch:
        # savefig would draw once more before, to lay out what is laid out here.
        figure.canvas.print_png(scratch, metadata={"Software": "egosplat"}, pil_kwargs=_COMPRESSION)
    plt.close(figure)
