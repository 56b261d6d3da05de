"""Pages as figures, before they are files."""

from collections.abc import Callable
from itertools import combinations

import pytest
from matplotlib.figure import Figure

from egosplat import drawing as figure


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures as they were saved."""
    figures: list[Figure] = []
    monkeypatch.setattr(figure.plt, "close", figures.append)
    return figures


@pytest.fixture
def unreadable() -> Callable[[Figure], list[str]]:
    """``unreadable(figure)``: titles that overlap another one, and headings that are cut."""

    def find(figure: Figure) -> list[str]:
        figure.draw_without_rendering()
        titles = [axes.title for axes in figure.get_axes() if axes.title.get_text()]
        boxes = [(title.get_text(), title.get_window_extent()) for title in titles]
        overlapping = [a for (a, left), (_, right) in combinations(boxes, 2) if left.overlaps(right)]
        pages = (figure, *figure.subfigs)
        headings = [
            (text.get_text(), text.get_window_extent(), page.bbox) for page in pages for text in page.texts
        ]
        return overlapping + [text for text, box, page in headings if box.x0 < page.x0 or box.x1 > page.x1]

    return find
