"""Tests of the table of components."""

from pathlib import Path

import pytest
from ablation import COMPARED, VARIANTS, paired, table
from scores_bench.comparing import told

from egosplat.benchmark.scored_scenes import ScoredScene
from egosplat.benchmark.tables import Cell


def scored(accuracy: float, decibels: float) -> ScoredScene:
    score = {
        "accuracy": accuracy,
        "accuracy_interval": [accuracy - 0.1, accuracy + 0.1],
        "mean_iou": None,
        "mean_iou_interval": [None, None],
        "count": 10,
    }
    document = {
        "scores": dict.fromkeys(("all", "static", "dynamic"), score),
        "rendering": {name: {"psnr": decibels} for name in ("all", "static")},
    }
    return ScoredScene(Path("metrics.json"), "adt", "scene", "full", None, "synthetic", (), document)


def test_a_score_is_told_with_its_interval_where_there_is_one():
    assert told(Cell(percent=12.34, interval=(1.0, 20.06))) == "12.3 (1.0 to 20.1)"
    assert told(Cell(percent=12.34)) == "12.3" and told(Cell()) == "-"


def test_rows_of_each_variant_and_means_over_scenes():
    scenes = {
        name: {variant: scored(share, 20.0 + 10 * share) for variant in VARIANTS}
        for name, share in (("adt/scene1", 0.2), ("adt/scene2", 0.4))
    }
    rows = table(scenes).splitlines()[2:]
    assert len(rows) == 3 * len(VARIANTS)
    assert rows[0].startswith("| adt/scene1 | baseline | 10 | 20.0 (10.0 to 30.0) |")
    assert rows[-1].startswith("| mean of 2 | full | 20 | 30.0 (22.9 to 37.1) |")
    assert rows[-1].endswith("| - | 23.00 | 23.00 |")


@pytest.mark.parametrize("count", [0, 1])
def test_one_scene_has_no_mean(count):
    scenes = {"adt/scene1": {variant: scored(0.2, 20.0) for variant in VARIANTS}} if count else {}
    assert "mean" not in table(scenes)


def answered(*found: tuple[bool, float]) -> ScoredScene:
    """Queries of one frame with whether they were found, and their IoU."""
    rows = [
        {"frame": 3, "category": f"thing {number}", "groups": {"all": {"hit": hit, "iou": iou}}}
        for number, (hit, iou) in enumerate(found)
    ]
    return ScoredScene(Path("metrics.json"), "adt", "scene", "full", None, "synthetic", (), {"queries": rows})


def test_variants_are_compared_query_by_query():
    better = answered((True, 0.5), (True, 0.2), (False, 0.0))
    worse = answered((True, 0.4), (False, 0.0), (True, 0.3))
    scenes = {
        "adt/scene1": {"baseline": worse, "aggregation": better, "initial": better, "full": better},
        "adt/scene2": {"baseline": worse, "aggregation": worse, "initial": worse, "full": better},
    }
    rows = paired(scenes).splitlines()[2:]
    assert len(rows) == len(COMPARED)
    assert rows[0].startswith("| aggregation against baseline | 6 | 1 | 1 | +0.0 (")
    assert (
        rows[1] == "| initial against aggregation | 6 | 0 | 0 | +0.0 (+0.0 to +0.0) | +0.0 (+0.0 to +0.0) |"
    )
    assert rows[3].startswith("| full against baseline | 6 | 2 | 2 | +0.0 (") and "| +0.0 (" in rows[3]
