"""Titles stay over their own picture and names inside it, whatever its shape."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure

from egosplat.drawing import NAME, add_name, arrange_texts, plt

TITLE = "evaluated, frame 123: 45 instances"


def page(height: int, width: int, columns: int = 4) -> Figure:
    figure, grid = plt.subplots(2, columns, figsize=(1.4 * columns, 5), layout="constrained", squeeze=False)
    figure.suptitle("a recording of some length, origin synthetic, " * 3)
    for axes in grid.flat:
        axes.imshow(np.zeros((height, width)))
        axes.set_title(TITLE, fontsize=9)
        axes.set_axis_off()
    return figure


@pytest.mark.parametrize("height, width", [(160, 90), (100, 100), (90, 160)])
def test_titles_of_neighbors_do_not_overlap_and_the_heading_is_not_cut(unreadable, height, width):
    figure = page(height, width)
    assert len(unreadable(figure)) > 6
    arrange_texts(figure)
    assert unreadable(figure) == []
    assert " ".join(figure.get_axes()[0].title.get_text().split()) == TITLE
    plt.close(figure)


def named(places: list[tuple[float, float, str]]) -> list[str]:
    """The names that stay: inside the picture, and none over another."""
    figure = page(100, 100, columns=2)
    axes = figure.get_axes()[1]
    for place in places:
        add_name(axes, *place)
    arrange_texts(figure)
    figure.draw_without_rendering()
    picture = axes.get_window_extent().padded(0.5)
    names = [text for text in axes.texts if text.get_gid() == NAME]
    boxes = [name.get_window_extent() for name in names]
    assert all(picture.x0 <= box.x0 and box.x1 <= picture.x1 for box in boxes)
    assert all(picture.y0 <= box.y0 and box.y1 <= picture.y1 for box in boxes)
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    plt.close(figure)
    return [name.get_text() for name in names]


@pytest.mark.parametrize("u, v", [(0, 0), (99, 50), (0, 99), (50, 99), (50, 50)])
def test_a_name_at_the_border_is_not_cut_and_one_wider_than_the_picture_dropped(u, v):
    wide = "a name that is wider than any picture " * 3
    assert named([(50, 50, wide), (u, v, "refrigerator")]) == ["refrigerator"]


def test_names_at_one_place_are_moved_apart_and_later_ones_dropped_where_there_is_no_room():
    few = ["first", "second", "third", "fourth"]
    assert named([(50, 50, name) for name in few]) == few
    names = named([(50, 50, f"thing {number}") for number in range(60)])
    assert names[0] == "thing 0" and 10 < len(names) < 60
