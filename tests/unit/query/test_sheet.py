"""The page of answers: pictures of one size, and a line for a query without an answer."""

import numpy as np
from PIL import Image

from egosplat.query.answers import Answer, ViewMatch
from egosplat.query.command import draw_answers

REFUSED = Answer("zeppelin", "not found", 0.2, refusal="not found: " + "a long reason " * 6), "", None


def answer(phrase: str):
    """One that is drawn in gray, without relevancy, all of it in the mask."""
    gray, nothing = np.full((40, 40, 3), 0.5, np.float32), np.zeros((40, 40), np.float32)
    view = ViewMatch(phrase, 0.9, "whole", (20, 20), None, nothing, "whole", nothing == 0)
    return Answer(phrase, "found", 0.9, view=view), "", gray


def test_a_long_refusal_does_not_widen_a_column(tmp_path):
    """The three pictures of a row are equally wide, whatever is written below."""
    draw_answers([answer("cup"), REFUSED], "a scene", tmp_path / "page.png")
    page = np.asarray(Image.open(tmp_path / "page.png").convert("L")).astype(int)
    # The row of pixels with the most ink crosses the pictures.
    inked = (page < 250)[(page < 250).sum(axis=1).argmax()]
    edges = np.flatnonzero(np.diff(np.r_[0, inked.astype(int), 0]))
    widths = np.sort(edges[1::2] - edges[::2])[-3:]
    assert widths.min() > 0.95 * widths.max() > 0.2 * page.shape[1]
