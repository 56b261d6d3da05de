"""Tests of the table of components, and of answers to the same queries held against each other."""

from pathlib import Path

from benchmarks.ablation.__main__ import COMPARED, VARIANTS, differences, table
from benchmarks.scores import accuracy_difference, iou_difference, pair_answers, queries_of
from egosplat.evaluation.scored_scenes import ScoredScene

OPTIONS = {"options": {"confidence": 0.95}}


def answered(*found: tuple[str, bool, float], decibels: float = 20.0, name: str = "scene1") -> ScoredScene:
    """Queries of a category each with whether they were found, and their IoU."""
    rows = [
        {"frame": frame, "category": category, "groups": {"all": {"hit": hit, "iou": iou}}}
        for frame, (category, hit, iou) in enumerate(found)
    ]
    share = sum(hit for _, hit, _ in found) / len(found)
    score = {
        "accuracy": share,
        "accuracy_interval": [share - 0.1, share + 0.1],
        "mean_iou": None,
        "mean_iou_interval": None,
        "count": len(found),
        "categories": len({category for category, _, _ in found}),
        "random_pixel": 0.05,
        "middle_pixel": 0.15,
    }
    document = {
        "scores": dict.fromkeys(("all", "static", "dynamic"), score),
        "queries": rows,
        "rendering": {group: {"psnr": decibels} for group in ("all", "static")},
        "provenance": OPTIONS,
    }
    return ScoredScene(Path("metrics.json"), "adt", name, "full", None, "synthetic", (), document)


def of_share(hits: int, decibels: float) -> ScoredScene:
    """Ten categories of one query each."""
    return answered(*((f"thing {n}", n < hits, 0.5) for n in range(10)), decibels=decibels)


def test_rows_of_each_variant_and_means_over_scenes():
    scenes = {
        name: {variant: of_share(hits, 20.0 + hits) for variant in VARIANTS}
        for name, hits in (("adt/scene1", 2), ("adt/scene2", 4))
    }
    rows = table(scenes).splitlines()[2:]
    assert len(rows) == 3 * len(VARIANTS)
    assert rows[0].startswith("| adt/scene1 | baseline | 10 | 10 | 20.0 (10.0 to 30.0) | 5.0 | 15.0 |")
    assert rows[-1].startswith("| mean of 2 | full | 20 | 20 | 30.0 (")
    assert " | 5.0 | 15.0 | - | - | 50.0 (" in rows[-1] and rows[-1].endswith(" | 23.00 | 23.00 |")


def test_variants_are_compared_query_by_query():
    names = [f"thing {n}" for n in range(8)]
    better = answered(*((name, n < 7, 0.5) for n, name in enumerate(names)))
    worse = answered(*((name, n == 7, 0.3) for n, name in enumerate(names)))
    scenes = {
        "adt/scene1": {"baseline": worse, "no_masks": better, "network_masks": better, "full": better},
        "adt/scene2": {"baseline": worse, "no_masks": worse, "network_masks": worse, "full": better},
    }
    rows = differences(scenes).splitlines()[2:]
    assert len(rows) == len(COMPARED)
    assert rows[0].startswith("| no_masks against baseline | 16 | 7 | 1 | +37.5 (")
    assert "p = 0.07 |" in rows[0]
    # Equal answers leave the doubt of sixteen categories, not none.
    assert rows[1].startswith(
        "| network_masks against no_masks | 16 | 0 | 0 | +0.0 (-19.4 to +19.4), p = 1 |"
    )
    assert rows[3].startswith("| full against baseline | 16 | 14 | 2 | +75.0 (") and "p = 0.0042" in rows[3]


def test_one_thing_seen_in_many_frames_is_one_difference():
    """Ten frames of one category that only one of two finds: no evidence about other categories, whatever p says."""
    mine = answered(*(("cup", True, 0.5) for _ in range(10)), *((f"thing {n}", True, 0.5) for n in range(9)))
    theirs = answered(
        *(("cup", False, 0.5) for _ in range(10)), *((f"thing {n}", True, 0.5) for n in range(9))
    )
    pair = pair_answers(mine, theirs)
    assert (queries_of([pair]), pair.gained, pair.lost, len(pair.hits.counts)) == (19, 10, 0, 10)
    told = accuracy_difference([pair])
    assert told.startswith("+52.6 (+0.0 to ") and told.endswith("p = 0.002")
    assert iou_difference([pair]) == "+0.0 (-27.8 to +27.8)"


def test_a_single_category_has_a_difference_without_an_interval():
    pair = pair_answers(answered(("cup", True, 0.5)), answered(("cup", False, 0.1)))
    assert accuracy_difference([pair]) == "+100.0 (fewer than two categories), p = 1"
