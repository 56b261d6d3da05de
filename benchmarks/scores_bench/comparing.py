"""Scores of scenes in words, and answers to the same queries held against each other."""

from collections.abc import Sequence
from dataclasses import dataclass

from egosplat.errors import UserError
from egosplat.evaluation.intervals import (
    RESAMPLING,
    Clusters,
    cluster,
    clustered_interval,
    mcnemar,
    mean_of_scenes,
)
from egosplat.tables.averages import average_chance
from egosplat.tables.scored_scenes import CHANCE, ScoredScene
from egosplat.tables.table import Cell

SCORES = (("accuracy", "all"), ("accuracy", "static"), ("accuracy", "dynamic"), ("mean_iou", "all"))
"""Those that tables show: name and group of queries."""

METHOD = (
    "95 % intervals over categories (bootstrap; of several scenes over scenes and categories): queries of one category are "
    "one thing seen from several frames. p is McNemar's exact one, which takes queries for independent."
)
"""What the intervals are, for the head of a page."""


def told(cell: Cell) -> str:
    """With its interval; of a single category there is none, which is said."""
    if cell.percent is None:
        return "-"
    if cell.categories == 1:
        return f"{cell.percent:.1f} (one category)"
    interval = f" ({cell.interval[0]:.1f} to {cell.interval[1]:.1f})" if cell.interval else ""
    return f"{cell.percent:.1f}{interval}"


def chance(scenes: Sequence[ScoredScene]) -> str:
    """What answers without looking would find, of all queries, as a sentence; the mean over scenes."""
    named = {str(number): scene for number, scene in enumerate(scenes)}
    shares = {name: average_chance(named, key, "all").percent for key, name in CHANCE.items()}
    told = (f"{name} {'-' if percent is None else f'{percent:.1f} %'}" for name, percent in shares.items())
    return f"Found by chance: {', '.join(told)}."


def psnr(scene: ScoredScene, pixels: str) -> float:
    """Of held-out frames [dB]."""
    return scene.document["rendering"][pixels]["psnr"]


def seconds(scene: ScoredScene) -> float:
    """On processors, of all stages [s].

    Raises:
        UserError: an artifact is lost, and with it what it took.
    """
    artifacts = scene.document["artifacts"]
    if lost := [name for name, one in artifacts.items() if one is None]:
        raise UserError(f"{scene.path}: {', '.join(lost)} are lost; make them again")
    return sum(one["cpu_s"] for one in (*artifacts.values(), scene.document["provenance"]))


@dataclass(frozen=True, eq=False)
class Paired:
    """One scene's queries that two answerers were both asked.

    Attributes:
        hits: by how much one found them more, -1, 0 or 1 each, by category.
        ious: by how much the IoU of its mask is larger, by category.
        gained, lost: queries that it alone found, and that the other alone found.
    """

    hits: Clusters
    ious: Clusters
    gained: int
    lost: int


def paired(one: ScoredScene, other: ScoredScene) -> Paired:
    """The answers of one against those of the other."""
    mine, theirs = _answers(one), _answers(other)
    both = [query for query in mine if query in theirs]
    hits = [mine[query][0] - theirs[query][0] for query in both]
    ious = [mine[query][1] - theirs[query][1] for query in both]
    categories = [category for _, category in both]
    return Paired(cluster(hits, categories), cluster(ious, categories), hits.count(1), hits.count(-1))


def queries_of(pairs: Sequence[Paired]) -> int:
    """How many queries of all scenes were asked of both."""
    return int(sum(one.hits.counts.sum() for one in pairs))


def accuracy_difference(pairs: Sequence[Paired]) -> str:
    """The mean over scenes in percentage points, with its interval and McNemar's p."""
    return f"{_difference([one.hits for one in pairs])}, {p_value(pairs)}"


def iou_difference(pairs: Sequence[Paired]) -> str:
    """The same of the mIoU, with its interval."""
    return _difference([one.ious for one in pairs])


def p_value(pairs: Sequence[Paired]) -> str:
    """McNemar's exact p of all scenes' queries together."""
    p = mcnemar(sum(one.gained for one in pairs), sum(one.lost for one in pairs))
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def _difference(scenes: Sequence[Clusters]) -> str:
    interval = clustered_interval(scenes, RESAMPLING, least=-1.0, most=1.0)
    bounds = (
        f"{100 * interval.low:+.1f} to {100 * interval.high:+.1f}"
        if interval
        else "fewer than two categories"
    )
    return f"{100 * mean_of_scenes(scenes):+.1f} ({bounds})"


def _answers(scene: ScoredScene) -> dict[tuple[int, str], tuple[int, float]]:
    """By frame and category: 1 where a query was found, and the IoU of its mask."""
    rows = scene.document["queries"]
    return {
        (row["frame"], row["category"]): (int(row["groups"]["all"]["hit"]), row["groups"]["all"]["iou"])
        for row in rows
        if "all" in row["groups"]
    }
