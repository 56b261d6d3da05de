"""Coverage by instances and the length of their tracks."""

import numpy as np

from egosplat.segments.stage import Occupancy


def test_figures_count_shown_pixels_frames_and_instances():
    """Two levels of four pixels, the last without the scene: instance 0 is in both frames, 1 in the second, 2 in none."""
    occupancy, shown = Occupancy(3), np.array([[True, True, True, False]])
    nothing = np.full((1, 4), -1, np.int32)
    occupancy.add(np.stack([np.array([[0, -1, -1, -1]], np.int32), nothing]), shown)
    occupancy.add(
        np.stack([np.array([[0, 0, -1, -1]], np.int32), np.array([[-1, -1, 1, -1]], np.int32)]), shown
    )
    figures = occupancy.figures()
    assert figures["pixels_without_instance"] == 2 / 6
    assert figures["instances_per_frame"] == 1.5 and figures["frames_per_instance"] == 1.0
    assert occupancy.figures(tracked=False) == {
        name: value for name, value in figures.items() if name != "frames_per_instance"
    }


def test_occupancy_without_instances_is_defined():
    figures = Occupancy(0).figures()
    assert set(figures.values()) == {0.0}
