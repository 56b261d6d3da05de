"""What a number of minutes buys, from entries of tradeoff.json."""

import pytest

from egosplat_rivals.tradeoff.measured import ACCURACY, MEASURES, PSNR, WALL
from egosplat_rivals.tradeoff.scenes import best_within, bought, mean_points


def entry(label: str, minutes: float | None, accuracy: float | None, psnr: float | None = None) -> dict:
    """A point that takes so many minutes on the clock."""
    means = {
        WALL.name: minutes and 60 * minutes,
        ACCURACY.name: accuracy,
        PSNR.name: psnr,
    }
    found = {
        name: {"runs": [mean], "mean": mean, "low": None, "high": None}
        for name, mean in means.items()
        if mean
    }
    measures = {one.name: found.get(one.name) for one in MEASURES}
    return {
        "label": label,
        "front": True,
        "queries": 10,
        "gaussians": [100],
        "measures": measures,
        "stages": {},
    }


POINTS = [
    entry("slow", 40.0, 0.7, 28.0),
    entry("quick", 2.0, 0.5, 24.0),
    entry("useless", 20.0, 0.4, 24.0),
    entry("pretty", 50.0, 0.1, 30.0),
    entry("unknown", None, 0.9, 40.0),
]


def test_the_most_accurate_affordable_point_is_bought():
    assert best_within(POINTS, ACCURACY, 1) is None
    assert best_within(POINTS, ACCURACY, 2)["label"] == best_within(POINTS, ACCURACY, 30)["label"] == "quick"
    assert best_within(POINTS, ACCURACY, 1440)["label"] == "slow"
    assert best_within(POINTS, PSNR, 1440)["label"] == "pretty"


def test_of_two_equal_points_the_quicker_is_bought():
    assert best_within([entry("dear", 9.0, 0.5), entry("cheap", 8.0, 0.5)], ACCURACY, 10)["label"] == "cheap"


def test_rows_that_buy_no_more_are_left_out():
    rows = [(minutes, *(one and one["label"] for one in found)) for minutes, *found in bought(POINTS)]
    assert rows == [(1, None, None), (2, "quick", "quick"), (60, "slow", "pretty")]


def test_means_are_over_scenes_and_the_front_is_that_of_the_means():
    other = [entry("quick", 4.0, 0.7), entry("slow", 80.0, 0.3)]
    found = {one["label"]: one for one in mean_points([{"points": POINTS}, {"points": other}])}
    assert set(found) == {"quick", "slow"} and found["quick"]["queries"] == 20
    assert found["quick"]["measures"][WALL.name]["mean"] == pytest.approx(180)
    assert found["quick"]["measures"][ACCURACY.name]["mean"] == pytest.approx(0.6)
    assert found["quick"]["front"] and not found["slow"]["front"]


def test_one_scene_is_its_own_mean():
    assert mean_points([{"points": POINTS}]) == POINTS
