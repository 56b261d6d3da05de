"""Scores of finished scenes as text, and paired comparisons of two answers to the same queries."""

from collections.abc import Sequence
from dataclasses import dataclass

from scipy import stats

from egosplat.errors import UserError
from egosplat.evaluation.intervals import RESAMPLING, Clusters, cluster, clustered_interval, mean_of_scenes
from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.scored_scenes import Cell, ScoredScene
from egosplat_rivals.tables.paper_tables import average

# Name and query group of the scores in a table.
SCORES = (("accuracy", "all"), ("accuracy", "static"), ("accuracy", "dynamic"), ("mean_iou", "all"))

# How intervals and p values are computed, for the first lines of a page.
METHOD = (
    "95 % intervals over categories (bootstrap; with several scenes, over scenes and categories), because the queries of a "
    "category show one thing in several frames. p is from McNemar's exact test, which assumes independent queries."
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


@dataclass(frozen=True, eq=False)
class Paired:
    """Differences between two answers to the same queries of one scene.

    Attributes:
        hits: hit of the first minus hit of the second (-1, 0 or 1), by category.
        ious: IoU of the first minus IoU of the second, by category.
        gained, lost: number of queries that only the first found, and that only the second found.
    """

    hits: Clusters
    ious: Clusters
    gained: int
    lost: int


def differences(results: Sequence[tuple[str, tuple[int, float], tuple[int, float]]]) -> Paired:
    """Paired differences from the category, then hit and IoU of either answer, of each query."""
    categories = [category for category, _, _ in results]
    hits = [one[0] - other[0] for _, one, other in results]
    ious = [one[1] - other[1] for _, one, other in results]
    return Paired(cluster(hits, categories), cluster(ious, categories), hits.count(1), hits.count(-1))


def pair_answers(one: ScoredScene, other: ScoredScene) -> Paired:
    """Compare two scored scenes over the queries that both have."""
    mine, theirs = _answers(one), _answers(other)
    return differences([(query[1], mine[query], theirs[query]) for query in mine if query in theirs])


def queries_of(pairs: Sequence[Paired]) -> int:
    """Number of compared queries over all scenes."""
    return int(sum(one.hits.counts.sum() for one in pairs))


def mcnemar(gained: int, lost: int) -> float:
    """Exact two-sided p of as uneven a split of the queries that one of two answerers finds alone (McNemar 1947).

    It assumes independent queries; ``clustered_interval`` gives the interval over categories.
    """
    return float(stats.binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def accuracy_difference(pairs: Sequence[Paired]) -> str:
    """Mean accuracy difference over scenes in percentage points, with its interval and McNemar's p."""
    p = mcnemar(sum(one.gained for one in pairs), sum(one.lost for one in pairs))
    return f"{_difference([one.hits for one in pairs])}, {'p < 0.001' if p < 0.001 else f'p = {p:.2g}'}"


def iou_difference(pairs: Sequence[Paired]) -> str:
    """Mean mIoU difference over scenes in percentage points, with its interval."""
    return _difference([one.ious for one in pairs])


def _difference(scenes: Sequence[Clusters]) -> str:
    interval = clustered_interval(scenes, RESAMPLING, least=-1.0, most=1.0)
    if interval is None:
        return f"{100 * mean_of_scenes(scenes):+.1f} (fewer than two categories)"
    return f"{100 * mean_of_scenes(scenes):+.1f} ({100 * interval.low:+.1f} to {100 * interval.high:+.1f})"


def _answers(scene: ScoredScene) -> dict[tuple[int, str], tuple[int, float]]:
    """Hit (0 or 1) and IoU by frame and category."""
    return {
        (row["frame"], row["category"]): (int(row["groups"]["all"]["hit"]), row["groups"]["all"]["iou"])
        for row in scene.document["queries"]
        if "all" in row["groups"]
    }
