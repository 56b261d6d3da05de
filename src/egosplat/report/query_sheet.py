"""Answers on one page: for each query the place, the relevancy and the mask in the rendered view."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.output_files import picture_kind
from egosplat.plotting import plt, save_picture
from egosplat.query.answer import Answer
from egosplat.report.answer_drawing import draw_heat, draw_mask

QUERY_PICTURE = picture_kind("egosplat query")

CELL = 4.0
"""Height of a picture, in inches."""

LETTERS_PER_INCH = 11
"""Of the title."""


def draw_answers(
    picture: NDArray[np.float32], answers: Sequence[Answer], levels: Sequence[str], title: str, output: Path
) -> None:
    """Draw the page as PNG; the file appears when it is complete.

    Args:
        picture: (H, W, 3) float32 in [0, 1], the rendered view.
        answers: a row each, one at least.
        levels: their names.
        title: above all; lines that are too long are broken.
        output: the file.
    """
    height, width, _ = picture.shape
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    size = (3 * cell, len(answers) * (CELL + 0.35) + 0.6)
    figure, grid = plt.subplots(len(answers), 3, squeeze=False, figsize=size, layout="constrained")
    lines = (fill(line, int(LETTERS_PER_INCH * size[0])) for line in title.split("\n"))
    figure.suptitle("\n".join(lines), fontsize=12)
    for cells, answer in zip(grid, answers, strict=True):
        _draw(cells, picture, answer, levels)
    save_picture(figure, output, QUERY_PICTURE)


def _draw(
    cells: NDArray[np.object_], picture: NDArray[np.float32], answer: Answer, levels: Sequence[str]
) -> None:
    place, heat, mask = cells
    for axes in cells:
        axes.set_axis_off()
    place.imshow(picture)
    place.set_title(f'"{answer.phrase}": {answer.score:.2f}', fontsize=10)
    if answer.level is None or answer.mask_level is None:
        heat.set_title("nothing is seen here", fontsize=10)
        return
    _mark(place, answer)
    draw_heat(heat, picture, answer)
    _mark(heat, answer)
    heat.set_title(f"relevancy 0 to 1, {levels[answer.level]}", fontsize=10)
    draw_mask(mask, picture, answer)
    mask.set_title(f"mask, {levels[answer.mask_level]}", fontsize=10)


def _mark(axes: Axes, answer: Answer) -> None:
    """A ring around the most relevant pixel."""
    if answer.pixel is not None:
        axes.scatter(*answer.pixel, s=130, facecolors="none", edgecolors="black", linewidths=3.5)
        axes.scatter(*answer.pixel, s=130, facecolors="none", edgecolors="white", linewidths=1.5)
