"""Pages as figures, before they are files."""

from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from egosplat import drawing as figure
from egosplat.pipeline.stages import STAGES, run_stage


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
        texts = [(text, page.bbox) for page in pages for text in page.texts]
        headings = [(text.get_text(), text.get_window_extent(), box) for text, box in texts]
        return overlapping + [text for text, box, page in headings if box.x0 < page.x0 or box.x1 > page.x1]

    return find


@pytest.fixture
def draw(tmp_path: Path) -> Callable[..., NDArray[np.int64]]:
    """``draw(stage, artifacts, title)``: the (H, W, 3) page of a stage, which is all that it writes."""

    def page(stage: str, artifacts: Sequence[Path], title: str = "a scene") -> NDArray[np.int64]:
        output = tmp_path / STAGES[stage].output
        given = dict(zip(STAGES[stage].inputs, artifacts, strict=True))
        run_stage(stage, None, **given, output=output, title=title)
        assert [path.name for path in tmp_path.iterdir() if path.suffix == ".png"] == [output.name]
        return np.asarray(Image.open(output).convert("RGB")).astype(int)

    return page
