"""Draw answers on one page: for each query the location, the relevancy and the mask in the rendered view."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.drawing import draw_heat, draw_mask, hide_axes, plt, save_figure
from egosplat.query.answers import NOTHING, Answer

# Height of an image [inches].
CELL = 4.0

# An answer with its match in a view, the view's name if each answer has its own, and its (H, W, 3) picture in [0, 1].
DrawnAnswer = tuple[Answer, str, NDArray | None]


def draw_answers(answers: Sequence[DrawnAnswer], title: str, output: Path) -> None:
    """Draw the page as PNG, atomically.

    Args:
        answers: one per row, at least one.
        title: title of the page; long lines are wrapped.
    """
    shapes = [picture.shape for _, _, picture in answers if picture is not None]
    height, width = shapes[0][:2] if shapes else (1, 1)
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    # A refused query takes one line.
    heights = [0.6 if picture is None else CELL + 0.35 for _, _, picture in answers]
    figure = plt.figure(figsize=(3 * cell, sum(heights) + 0.8), layout="constrained")
    grid = figure.subplots(len(answers), 3, squeeze=False, height_ratios=heights)
    figure.suptitle(title, fontsize=12)
    for cells, drawn in zip(grid, answers, strict=True):
        _draw(cells, *drawn)
    save_figure(figure, output)


def _draw(cells: NDArray[np.object_], answer: Answer, where: str, picture: NDArray | None) -> None:
    for axes in cells:
        hide_axes(axes)
    (place, heat, mask), view = cells, answer.view
    if picture is None or view is None:
        caption = f'"{answer.phrase}": {answer.refusal or NOTHING}'
        # Outside of the layout: otherwise the first column becomes as wide as the text.
        place.text(0.0, 0.5, caption, fontsize=10, transform=place.transAxes, clip_on=False, in_layout=False)
        return
    place.set_title(f'"{answer.phrase}": {answer.grade}{where and f", {where}"}', fontsize=10)
    place.imshow(picture)
    draw_heat(heat, picture, view.relevancy)
    heat.set_title(f"relevancy 0 to 1, {view.level}", fontsize=10)
    for axes in (place, heat):
        if view.pixel is None:
            break
        axes.scatter(*view.pixel, s=130, facecolors="none", edgecolors="black", linewidths=3.5)
        axes.scatter(*view.pixel, s=130, facecolors="none", edgecolors="white", linewidths=1.5)
    draw_mask(mask, picture, view.mask)
    mask.set_title(f"mask, {view.mask_level}", fontsize=10)
