"""What variants cost and reach, as metrics.json tells it; the front, and what a number of minutes buys."""

import math

import pandas as pd
import pytest

from egosplat.errors import UserError
from egosplat_rivals.tradeoff import measured
from egosplat_rivals.tradeoff.measured import best_within, find_front, list_numbers, mean_points, read_runs


def test_costs_are_of_what_makes_the_scene(variant):
    numbers = list_numbers(read_runs([variant(None, minutes=10.0)]))
    totals = numbers[numbers.stage == ""].set_index("measure")
    expected = {"wall_s": 601, "cpu_s": 1202, "peak_memory_mb": 1100, "disk_mb": 20, "accuracy": 0.5}
    assert totals.value[list(expected)].to_dict() == expected
    assert (totals.low["accuracy"], totals.high["accuracy"]) == (0.4, 0.6)
    assert set(totals.index) == {*measured.MEASURES}
    assert set(numbers.stage) == {"", "frames", "annotations", "splats", "metrics"}
    assert set(numbers.about) == {"synthetic apartments, small checkpoints"}


def test_an_interrupted_training_counts_whole_and_a_lost_cost_is_unknown(variant):
    runs = read_runs([variant(None, minutes=1.0, splats={"training_s": 500.0, "disk_mb": None})])
    (totals,) = mean_points(list_numbers(runs)).to_dict("records")
    assert totals["wall_s"] == 501.0 and math.isnan(totals["disk_mb"])


def test_the_mean_is_over_points_that_all_scenes_have(variant):
    runs = [variant(None, 0.5, 10.0), variant("draft", 0.4, 2.0), variant("own", 0.9, 2.0)]
    runs += [variant(None, 0.7, 30.0, scene="scene2"), variant("draft", 0.5, None, scene="scene2")]
    numbers = list_numbers(read_runs(runs))
    means = mean_points(numbers)
    assert list(means.index) == ["the scene", "draft"]
    assert means.accuracy.tolist() == pytest.approx([0.6, 0.45])
    # A scene that does without a stage counts as 0.
    assert mean_points(numbers, "splats").wall_s.tolist() == [1200.0, 60.0]


def test_what_cannot_be_compared_is_rejected(variant):
    whole = variant(None)
    for other, words in (
        (variant("strict", options={"masks": "classes"}), "strict/metrics.json.* metrics.masks"),
        (variant("lerf", method="LERF"), "lerf/metrics.json.* LERF"),
        (variant("lost", splats=None), "splats.zarr"),
        (whole.with_name("absent.json"), "absent.json"),
    ):
        with pytest.raises(UserError, match=words):
            read_runs([whole, other])


def points(*values: tuple[float, float], gain: str = "accuracy") -> pd.DataFrame:
    """Points of wall time [min] and gain, named by their place."""
    rows = [{"wall_s": 60 * cost, gain: value} for cost, value in values]
    return pd.DataFrame(rows, index=[str(row) for row in range(len(rows))], columns=["wall_s", gain])


@pytest.mark.parametrize(
    "values, expected",
    [
        ([], ""),
        ([(1.0, 0.5)], "0"),
        ([(2.0, 0.5), (1.0, 0.4), (3.0, 0.45)], "10"),
        ([(1.0, 0.4), (1.0, 0.5)], "1"),
        ([(1.0, 0.5), (2.0, 0.5)], "0"),
        ([(1.0, 0.5), (1.0, 0.5)], "01"),
        ([(3.0, 0.9), (2.0, 0.8), (1.0, 0.7)], "210"),
        ([(1.0, math.nan), (2.0, 0.5), (math.nan, 0.9)], "1"),
    ],
)
def test_the_pareto_front_is_not_dominated(values, expected):
    assert find_front(points(*values)) == list(expected)


@pytest.mark.parametrize("minutes, label", [(1, None), (2, "1"), (30, "1"), (1440, "0")])
def test_the_best_affordable_point_is_bought(minutes, label):
    offered = [(40.0, 0.7), (2.0, 0.5), (20.0, 0.4), (2.0, 0.5), (math.nan, 0.9)]
    assert best_within(points(*offered, gain="psnr"), "psnr", minutes) == label
