"""Tests of plain numbers on logarithmic axes."""

import matplotlib
from matplotlib import pyplot as plt

from egosplat.log_axis import plain_numbers


def test_labels_are_numbers_and_no_formulas():
    with matplotlib.rc_context({"text.parse_math": False}):
        figure, axes = plt.subplots()
        axes.semilogy([1, 2, 3], [0.03, 0.2, 1.5])
        plain_numbers(axes.yaxis)
        figure.canvas.draw()
        labels = [label.get_text() for label in axes.get_yticklabels(which="both") if label.get_text()]
    plt.close(figure)
    assert {"0.05", "0.1", "0.2", "1"} <= set(labels) and not any("$" in label for label in labels)
