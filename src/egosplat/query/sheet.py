"""Draw answers on one page: for each query the location, the relevancy and the mask in the rendered view."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.drawing import draw_heat, draw_mask, hide_axes, plt, save_figure
from egosplat.query.command import NOTHING, DrawnAnswer

# Height of an image [inches].
CELL = 4.0


def draw_answers(answers: Sequence[DrawnAnswer], title: str, output: Path) -> None:
    """Draw the page as PNG, atomically.

    Args:
        answers: one per row, at least one.
        title: title of the page; long lines are wrapped.
    """
    shapes = [one.picture.shape for one in answers if one.picture is not None]
    height, width = shapes[0][:2] if shapes else (1, 1)
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    # A refused query takes one line.
    heights = [0.6 if one.picture is None else CELL + 0.35 for one in answers]
    figure = plt.figure(figsize=(3 * cell, sum(heights) + 0.8), layout="constrained")
    grid = figure.subplots(len(answers), 3, squeeze=False, height_ratios=heights)
    figure.suptitle(title, fontsize=12)
    for cells, answer in zip(grid, answers, strict=True):
        _draw(cells, answer)
    save_figure(figure, output)


def _draw(cells: NDArray[np.object_], drawn: DrawnAnswer) -> None:
    place, heat, mask = cells
    for axes in cells:
        hide_axes(axes)
    answer, view = drawn.answer, drawn.view
    where = f", {drawn.where}" if drawn.where else ""
    caption = f'"{answer.phrase}": {answer.grade}{where}'
    if drawn.picture is None or view is None:
        caption = f'"{answer.phrase}": {answer.refusal or NOTHING}'
        # Outside of the layout: otherwise the first column becomes as wide as the text.
        place.text(0.0, 0.5, caption, fontsize=10, transform=place.transAxes, clip_on=False, in_layout=False)
        return
    place.set_title(caption, fontsize=10)
    place.imshow(drawn.picture)
    _mark(place, view.pixel)
    draw_heat(heat, drawn.picture, view.relevancy)
    _mark(heat, view.pixel)
    heat.set_title(f"relevancy 0 to 1, {view.level}", fontsize=10)
    draw_mask(mask, drawn.picture, view.mask)
    mask.set_title(f"mask, {view.mask_level}", fontsize=10)


def _mark(axes: Axes, pixel: tuple[int, int] | None) -> None:
    """Draw a ring around a pixel."""
    if pixel is not None:
        axes.scatter(*pixel, s=130, facecolors="none", edgecolors="black", linewidths=3.5)
        axes.scatter(*pixel, s=130, facecolors="none", edgecolors="white", linewidths=1.5)
