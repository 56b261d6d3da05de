"""Labels of the plot can be read, however close their points are."""

import itertools

import pytest

from egosplat.drawing import plt
from egosplat_rivals.tradeoff.chart import place_labels


@pytest.fixture
def axes():
    figure, axes = plt.subplots(figsize=(6, 5))
    axes.set(xlim=(0.5, 1440), ylim=(0, 100), xscale="log")
    yield axes
    plt.close(figure)


def test_labels_of_points_in_one_place_do_not_overlap(axes):
    points = [(10.0 + 0.3 * number, 50.0 + 0.5 * number) for number in range(8)]
    place_labels(axes, {f"splats.iterations={number}": point for number, point in enumerate(points)})
    renderer, frame = axes.figure.canvas.get_renderer(), axes.get_window_extent()
    labels = [text for text in axes.texts if text.get_text()]
    boxes = [text.get_window_extent(renderer) for text in labels]
    assert len(boxes) == 8
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert all(frame.contains(*box.min) and frame.contains(*box.max) for box in boxes)


def test_without_room_no_label_is_lost(axes):
    labels = {
        f"a label that is too long for these axes {'x' * 80} {number}": (10.0, 50.0) for number in range(3)
    }
    place_labels(axes, labels)
    assert {text.get_text() for text in axes.texts if text.get_text()} == set(labels)


def test_a_plot_without_points_has_no_labels(axes):
    place_labels(axes, {})
    assert not axes.texts
