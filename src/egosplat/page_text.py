"""Fit the texts of a page: wrap titles to the width of their image, and move names inside it and apart.

The sizes of texts and images are known only after the layout of the page.
"""

from collections.abc import Iterator
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.text import Text
from matplotlib.transforms import Bbox

# Group id of texts that name something in an image.
NAME = "name"

# Maximum width of a heading, as a share of the page's width.
HEADING_WIDTH = 0.98

# Distance of a name from the image border and from other names [points].
_GAP = 2

_BOX = {"facecolor": "black", "alpha": 0.55, "pad": 1, "edgecolor": "none"}


def add_name(axes: Axes, u: float, v: float, text: str) -> None:
    """Write a name at column u and row v of an image; ``arrange_texts`` may move or drop it."""
    style = {"color": "white", "fontsize": 7, "ha": "center", "va": "center", "bbox": _BOX}
    axes.text(u, v, text, gid=NAME, in_layout=False, **style)


def arrange_texts(figure: Figure) -> None:
    """Wrap titles to the width of their axes and headings to that of their page, then move names into the image and apart.

    Names are placed in order; a name that overlaps earlier ones everywhere is dropped.
    """
    figure.draw_without_rendering()
    wrapped = [wrap_text(text, room) for text, room in _titles(figure)]
    named = [axes for axes in figure.get_axes() if _names(axes)]
    if any(wrapped) and named:
        figure.draw_without_rendering()
    for axes in named:
        _place_names(axes, figure.dpi)


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


def _names(axes: Axes) -> list[Text]:
    return [text for text in axes.texts if text.get_gid() == NAME]


def _place_names(axes: Axes, dpi: float) -> None:
    inside = axes.get_window_extent()
    kept: list[Bbox] = []
    for name in _names(axes):
        box = name.get_window_extent().padded(_GAP * dpi / 72)
        place = _free_place(box, inside, kept)
        if place is None:
            name.remove()
            continue
        kept.append(place)
        name.set_position(
            axes.transData.inverted().transform(((place.x0 + place.x1) / 2, (place.y0 + place.y1) / 2))
        )


def _free_place(box: Bbox, inside: Bbox, taken: list[Bbox]) -> Bbox | None:
    """Move a box inside, or also one line up or down; None if all three overlap a taken box or do not fit."""
    if box.width > inside.width or box.height > inside.height:
        return None
    for up in (0.0, box.height, -box.height):
        right = _into(box.x0, box.x1, inside.x0, inside.x1)
        moved = box.translated(right, up + _into(box.y0 + up, box.y1 + up, inside.y0, inside.y1))
        if not moved.count_overlaps(taken):
            return moved
    return None


def _into(low: float, high: float, least: float, most: float) -> float:
    """The shift that moves an interval into another."""
    return max(least - low, 0.0) or min(most - high, 0.0)
