"""Texts on a page that fit: titles wrapped to their picture's width, names kept inside it and apart from each other.

How wide a text is, and how large a picture becomes, is known only after the page is laid out.
"""

from collections.abc import Iterator
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.text import Text
from matplotlib.transforms import Bbox

NAME = "name"
"""The id of texts that name something in a picture."""

HEADING_WIDTH = 0.98
"""Share of a page's width that its heading may take."""

_GAP = 2
"""Between a name and the picture's border or another name [points]."""

_BOX = {"facecolor": "black", "alpha": 0.55, "pad": 1, "edgecolor": "none"}


def add_name(axes: Axes, u: float, v: float, text: str) -> None:
    """Name what is at column u and row v of a picture; ``arrange_texts`` may move or drop the name."""
    style = {"color": "white", "fontsize": 7, "ha": "center", "va": "center", "bbox": _BOX}
    axes.text(u, v, text, gid=NAME, in_layout=False, **style)


def arrange_texts(figure: Figure) -> None:
    """Wrap each title to the width that its picture may take and each heading to that of its page, then move names into
    their pictures and apart; a name that finds no place is dropped, the later one first."""
    figure.draw_without_rendering()
    wrapped = [wrap_text(text, room) for text, room in _titles(figure)]
    named = [axes for axes in figure.get_axes() if _names(axes)]
    if any(wrapped) and named:
        figure.draw_without_rendering()
    for axes in named:
        _settle(axes, figure.dpi)


def _titles(figure: Figure) -> Iterator[tuple[Text, float]]:
    """Headings and titles, with the width [pixels] that there is for each."""
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
    """Break lines that are wider than ``room`` [pixels]; whether there was one."""
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


def _settle(axes: Axes, dpi: float) -> None:
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
    """The box moved inside, else a line above or below; None where all three overlap what is taken or are too large."""
    if box.width > inside.width or box.height > inside.height:
        return None
    for up in (0.0, box.height, -box.height):
        right = _into(box.x0, box.x1, inside.x0, inside.x1)
        moved = box.translated(right, up + _into(box.y0 + up, box.y1 + up, inside.y0, inside.y1))
        if not moved.count_overlaps(taken):
            return moved
    return None


def _into(low: float, high: float, least: float, most: float) -> float:
    """By how much to move an interval so that it lies within another."""
    return max(least - low, 0.0) or min(most - high, 0.0)
