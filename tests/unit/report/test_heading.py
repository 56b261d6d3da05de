"""A page's heading: its lines fit, and the page grows by those of warnings."""

import pytest

from egosplat.plotting import plt
from egosplat.report.heading import draw_heading


@pytest.fixture
def figure():
    made = plt.figure(figsize=(5.0, 4.0), layout="constrained")
    yield made
    plt.close(made)


def test_a_title_alone_leaves_the_page_as_it_is(figure):
    draw_heading(figure, "scene\nwhat it shows", [])
    assert figure.get_suptitle() == "scene\nwhat it shows" and figure.get_size_inches()[1] == 4.0


def test_warnings_stand_below_and_the_page_grows_by_them(figure):
    draw_heading(figure, "scene", ["alarm: one", "alarm: two"])
    assert figure.get_suptitle().splitlines() == ["scene", "alarm: one", "alarm: two"]
    assert figure.get_size_inches()[1] > 4.0


def test_lines_fit_the_page_however_long_and_no_word_is_lost(figure):
    words = [f"word{number}" for number in range(60)]
    draw_heading(figure, "scene", [" ".join(words)])
    figure.canvas.draw()
    box = figure._suptitle.get_window_extent()
    assert 0 <= box.x0 and box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height
    assert figure.get_suptitle().split()[1:] == words
