"""Labels of the plot can be read, however close their points are."""

import itertools

from egosplat.drawing import plt
from egosplat_rivals.tradeoff.chart import place_labels


def test_labels_of_points_in_one_place_do_not_overlap():
    figure, axes = plt.subplots(figsize=(6, 5))
    axes.set(xlim=(0.5, 1440), ylim=(0, 100), xscale="log")
    points = [(10.0 + 0.3 * number, 50.0 + 0.5 * number) for number in range(8)]
    place_labels(axes, {f"splats.iterations={number}": point for number, point in enumerate(points)})
    renderer, frame = figure.canvas.get_renderer(), axes.get_window_extent()
    boxes = [text.get_window_extent(renderer) for text in axes.texts if text.get_text()]
    assert len(boxes) == 8
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert all(frame.contains(*box.min) and frame.contains(*box.max) for box in boxes)
    plt.close(figure)
