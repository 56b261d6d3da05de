"""Scores of finished scenes as text, and paired comparisons of two answers to the same queries."""

from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.intervals.differences import paired_difference
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters, cluster
from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.scored_scenes import Cell, ScoredScene
from egosplat_rivals.tables.paper_tables import average

# Name and query group of the scores in a table.
SCORES = (("accuracy", "all"), ("accuracy", "static"), ("accuracy", "dynamic"), ("mean_iou", "all"))

# How intervals and p values are computed, for the first lines of a page.
METHOD = (
    "Scores have 95 % intervals of a bootstrap over categories and scenes. Differences have p, and the 95 % interval that agrees with "
    "it, from sign flips of each scene's categories; for other scenes, a t interval of the scenes' means where it is wider."
)


def format_score(cell: Cell) -> str:
    """A score in percent with its interval; a single category has none."""
    if cell.percent is None:
        return "-"
    if cell.categories == 1:
        return f"{cell.percent:.1f} (one category)"
    interval = f" ({cell.interval[0]:.1f} to {cell.interval[1]:.1f})" if cell.interval else ""
    return f"{cell.percent:.1f}{interval}"


def chance(scenes: Sequence[ScoredScene]) -> str:
    """A sentence with the accuracy of blind answers over all queries, averaged over scenes."""
    named = {str(number): scene for number, scene in enumerate(scenes)}
    shares = {name: average(named, key, "all").percent for key, name in CHANCE.items()}
    parts = (f"{name} {'-' if percent is None else f'{percent:.1f} %'}" for name, percent in shares.items())
    return f"Found by chance: {', '.join(parts)}."


def psnr(scene: ScoredScene, pixels: str) -> float:
    """PSNR of held-out frames over a group of pixels, ``all`` or ``static`` [dB]."""
    return scene.document["rendering"][pixels]["psnr"]


def seconds(scene: ScoredScene) -> float:
    """Processor time of all stages of a scene [s].

    Raises:
        UserError: an artifact is lost, and with it the record of its time.
    """
    artifacts = scene.document["artifacts"]
    if lost := [name for name, one in artifacts.items() if one is None]:
        raise UserError(f"{scene.path}: {', '.join(lost)} are lost; make them again")
    return sum(one["cpu_s"] for one in (*artifacts.values(), scene.document["provenance"]))


class Paired(NamedTuple):
    """Hits and IoUs of an answer to the queries of a scene, less those of another, by category."""

    hits: Clusters
    ious: Clusters


def differences(results: Sequence[tuple[str, tuple[int, float], tuple[int, float]]]) -> Paired:
    """Paired differences from the category, then hit and IoU of either answer, of each query."""
    categories = [category for category, _, _ in results]
    hits = [one[0] - other[0] for _, one, other in results]
    ious = [one[1] - other[1] for _, one, other in results]
    return Paired(cluster(hits, categories), cluster(ious, categories))


def pair_answers(one: ScoredScene, other: ScoredScene) -> Paired:
    """Compare two scored scenes over the queries that both have."""
    mine, theirs = _answers(one), _answers(other)
    return differences([(query[1], mine[query], theirs[query]) for query in mine if query in theirs])


def queries_of(pairs: Sequence[Paired]) -> int:
    """Number of compared queries over all scenes."""
    return int(sum(one.hits.counts.sum() for one in pairs))


def accuracy_difference(pairs: Sequence[Paired]) -> str:
    """Mean accuracy difference over scenes, see ``format_difference``."""
    return format_difference([one.hits for one in pairs])


def iou_difference(pairs: Sequence[Paired]) -> str:
    """Mean mIoU difference over scenes, see ``format_difference``."""
    return format_difference([one.ious for one in pairs])


def format_difference(scenes: Sequence[Clusters]) -> str:
    """A ``paired_difference`` in points, such as ``+3.1 (-2.0 to +8.2), p = 0.24``; - for nothing."""
    if not scenes:
        return "-"
    mean, interval, p, over_scenes = paired_difference(scenes)
    # Three digits where two would put p on the other side of the interval's limit.
    told = f"{p:.2g}" if (p < 0.05) == (float(f"{p:.2g}") < 0.05) else f"{p:.3g}"
    beside = f"; t over apartments: {_bounds(over_scenes)}" if over_scenes else ""
    return f"{_points(mean)} ({_bounds(interval)}), {'p < 0.001' if p < 0.001 else f'p = {told}'}{beside}"


def _bounds(interval: tuple[float, float]) -> str:
    return f"{_points(interval[0])} to {_points(interval[1])}"


def _points(difference: float) -> str:
    """Only zero itself has no sign."""
    return f"{100 * difference:+.1f}" if difference else "0.0"


def _answers(scene: ScoredScene) -> dict[tuple[int, str], tuple[int, float]]:
    """Hit (0 or 1) and IoU by frame and category."""
    return {
        (row["frame"], row["category"]): (int(row["groups"]["all"]["hit"]), row["groups"]["all"]["iou"])
        for row in scene.document["queries"]
        if "all" in row["groups"]
    }
