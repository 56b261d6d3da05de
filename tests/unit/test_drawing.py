"""Headings fit their page, which grows by warnings; logarithmic axes have plain numbers."""

import matplotlib
import pytest

from egosplat.drawing import draw_heading, label_log_axis, plt
from egosplat.images import evenly_spaced


@pytest.fixture
def figure():
    made = plt.figure(figsize=(5.0, 4.0), layout="constrained")
    yield made
    plt.close(made)


@pytest.mark.parametrize("warnings", [[], ["alarm: one", "alarm: two"]])
def test_warnings_extend_the_page_below_and_a_title_does_not(figure, warnings):
    draw_heading(figure, "scene\nwhat it shows", warnings)
    assert figure.get_suptitle().splitlines() == ["scene", "what it shows", *warnings]
    height = figure.get_size_inches()[1]
    assert height > 4.0 if warnings else height == 4.0


def test_lines_fit_the_page_however_long_and_no_word_is_lost(figure):
    words = [f"word{number}" for number in range(60)]
    draw_heading(figure, "scene", [" ".join(words)])
    figure.canvas.draw()
    box = figure._suptitle.get_window_extent()
    assert 0 <= box.x0 and box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height
    assert figure.get_suptitle().split()[1:] == words


def test_labels_are_numbers_and_no_formulas(figure):
    with matplotlib.rc_context({"text.parse_math": False}):
        axes = figure.subplots()
        axes.semilogy([1, 2, 3], [0.03, 0.2, 1.5])
        label_log_axis(axes.yaxis)
        figure.canvas.draw()
        labels = {label.get_text() for label in axes.get_yticklabels(which="both")}
    assert labels >= {"0.05", "0.1", "0.2", "1"} and "$" not in "".join(labels)


@pytest.mark.parametrize("count, spaced", [(0, []), (1, [0]), (3, [0, 1, 2]), (10, [0, 4, 9])])
def test_indices_are_evenly_spaced(count, spaced):
    assert evenly_spaced(count, 3) == spaced
