"""Tests of the table of components, and of answers to the same queries held against each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.figures import difference, difference_table, format_difference, pair
from benchmarks.rows import collect
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters
from egosplat_rivals.scored_scenes import ScoredScene
from tests.support.tables import SETUP

OPTIONS = {"options": {"confidence": 0.95}, "versions": {}, "cpu_s": 1.0, "peak_memory_mb": 1.0}


def truth(hit: bool, iou: float) -> dict:
    return {"hit": hit, "iou": iou, "random_hit": 0.05, "middle_hit": False}


def answered(*found: tuple[str, bool, float], name: str = "scene1") -> ScoredScene:
    """Queries of a category each with whether they were found, and their IoU."""
    rows = [
        {"frame": frame, "category": category, "groups": {"all": truth(hit, iou)}}
        for frame, (category, hit, iou) in enumerate(found)
    ]
    document = {
        "origin": "synthetic",
        "queries": rows,
        "provenance": OPTIONS,
        "artifacts": {},
        "frames": [],
        "counts": {},
        **SETUP,
    }
    return ScoredScene(Path("metrics.json"), "adt", name, "full", None, (), document)


def test_settings_are_compared_query_by_query():
    """Means over the scenes of a world; equal answers leave the doubt of sixteen categories, not none."""
    names = [f"thing {n}" for n in range(8)]
    better = answered(*((name, n < 7, 0.5) for n, name in enumerate(names)))
    worse = answered(*((name, n == 7, 0.3) for n, name in enumerate(names)))
    other = {"full": better, "no_masks": worse, "baseline": worse}
    first = {"full": better, "no_masks": better, "baseline": worse}
    found = {
        setting: [
            first[setting],
            replace(other[setting], scene="scene2"),
            replace(first[setting], scene="busy1"),
        ]
        for setting in ("full", "no_masks", "baseline")
    }
    rows = collect("ablation", found)
    table = difference_table(rows, "scene").splitlines()[2:]
    assert [row.split(" | ")[0] for row in table] == ["| full against no_masks", "| full against baseline"]
    assert table[1].startswith("| full against baseline | +75.0 (") and "p = 0.0035 |" in table[1]
    assert "| full against no_masks | 0.0 (" in difference_table(rows, "busy")
    assert difference_table(rows) not in (difference_table(rows, "scene"), difference_table(rows, "busy"))
    with pytest.raises(UserError, match="foreign1"):
        rows.within("foreign")
    same = difference_table(collect("ablation", {"full": found["full"], "again": found["full"]}), "scene")
    assert "| full against again | 0.0 (-19.4 to +19.4), p = 1 |" in same
    by_pixels = {"full": found["full"], **dict.fromkeys(("pixels", "occam_pixels"), found["no_masks"])}
    own, occam = difference_table(collect("ablation", by_pixels), "scene").splitlines()[2:]
    assert own.startswith("| full against pixels |") and occam.startswith("| pixels against occam_pixels |")


def test_one_thing_seen_in_many_frames_is_one_difference():
    """Ten frames of one category that only one of two finds: no evidence about other categories."""
    things = [(f"thing {n}", True, 0.5) for n in range(9)]
    mine, theirs = (answered(*[("cup", hit, 0.5)] * 10, *things) for hit in (True, False))
    rows = collect("ablation", {"mine": [mine], "theirs": [theirs]})
    queries = pair(rows, "mine", "theirs", "hit")
    assert (len(queries), queries["category"].nunique()) == (19, 10)
    assert difference(rows, "mine", "theirs", "accuracy") == "+52.6 (0.0 to +83.3), p = 1"
    assert difference(rows, "mine", "theirs", "mean_iou") == "0.0 (-27.8 to +27.8), p = 1"
    assert format_difference([]) == "-"


def test_a_p_just_below_the_limit_is_not_rounded_to_it():
    values = np.array([3, -3, 7, 8, 5, 5, -1, -1, 3, 1, 1]) / 10
    assert format_difference([Clusters(values, np.ones(11))]) == "+25.5 (+2.0 to +50.0), p = 0.0498"
