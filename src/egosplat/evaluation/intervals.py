"""Bootstrap intervals of scores over categories and scenes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

# Means of categories that differ by less are equal up to rounding.
SAME = 1e-12

# The bootstrap. Intervals of tests and simulations take fewer resamples.
CONFIDENCE, RESAMPLES, SEED = 0.95, 10_000, 0


@dataclass(frozen=True, eq=False)
class Clusters:
    """The values of one scene's queries: (K,) float64 sums by category, and (K,) float64 numbers of queries, at least 1."""

    totals: NDArray[np.float64]
    counts: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean over the queries; NaN without queries."""
        return float(self.totals.sum() / self.counts.sum()) if len(self.counts) else math.nan


def cluster(values: Sequence[float], categories: Sequence[str]) -> Clusters:
    """Sum the values of a scene's queries by category."""
    # Queries of one category in one scene show one thing from several frames, so they hit or miss together. The
    # bootstrap resamples categories, never queries.
    _, index = np.unique(np.asarray(categories, np.str_), return_inverse=True)
    totals = np.bincount(index, weights=np.asarray(values, np.float64))
    return Clusters(totals.astype(np.float64), np.bincount(index).astype(np.float64))


def mean_of_scenes(scenes: Sequence[Clusters]) -> float:
    """Plain mean of the scenes' means, as in the paper's tables, without scenes that have no queries."""
    means = [scene.mean for scene in scenes if len(scene.counts)]
    return math.fsum(means) / len(means) if means else math.nan


def clustered_interval(
    scenes: Sequence[Clusters], resamples: int = RESAMPLES, *, least: float = 0.0, most: float = 1.0
) -> tuple[float, float] | None:
    """Confidence interval of ``mean_of_scenes`` for other categories and scenes; None with fewer than two categories.

    An expanded percentile interval of the bootstrap, too narrow for few scenes that differ (benchmarks/intervals/README.md);
    ``least`` and ``most`` bound a value, such as -1 and 1 for a difference of hits.
    """
    scenes = [scene for scene in scenes if len(scene.counts)]
    means = np.concatenate([np.zeros(0), *(scene.totals / scene.counts for scene in scenes)])
    if len(means) < 2:
        return None
    # Resampling equal means gives no spread: Wilson's interval of 0 in K bounds the share of categories that could
    # differ, each by as much as is possible.
    if np.ptp(means) <= SAME:
        value = float(means[0])
        others = 1 / (1 + len(means) / special.ndtri((1 + CONFIDENCE) / 2) ** 2)
        return value - others * (value - least), value + others * (most - value)
    low, high = _bounds(scenes, len(means), resamples)
    return max(low, least), min(high, most)


def _bounds(scenes: Sequence[Clusters], clusters: int, resamples: int) -> tuple[float, float]:
    resampled = _resampled(scenes, resamples)
    # The percentiles are expanded for a small number K of categories: the tails are those of Student's distribution
    # times sqrt(K / (K - 1)) (Hesterberg 2015, "What teachers should know about the bootstrap").
    student = special.stdtrit(clusters - 1, (1 + CONFIDENCE) / 2) * math.sqrt(clusters / (clusters - 1))
    # The smallest and the largest of a few categories cover less than the confidence (of five, 94 %). Student's interval
    # with the bootstrap's standard deviation replaces the percentiles.
    if 2.0 ** (1 - clusters) > 1 - CONFIDENCE:
        mean, half = mean_of_scenes(scenes), float(student * resampled.std())
        return mean - half, mean + half
    low, high = np.quantile(resampled, special.ndtr([-student, student]))
    return float(low), float(high)


def _resampled(scenes: Sequence[Clusters], resamples: int) -> NDArray[np.float64]:
    """(R,) means of resampled scenes and categories: scenes first, then the categories of each drawn scene."""
    rng = np.random.default_rng(SEED)
    shape = (resamples, len(scenes))
    # A single scene is drawn always, so its interval covers other categories only.
    drawn = rng.integers(len(scenes), size=shape) if len(scenes) > 1 else np.zeros(shape, np.int64)
    means = np.empty(shape)
    for index, scene in enumerate(scenes):
        here = drawn == index
        chosen = rng.integers(len(scene.counts), size=(np.count_nonzero(here), len(scene.counts)))
        means[here] = scene.totals[chosen].sum(axis=1) / scene.counts[chosen].sum(axis=1)
    return means.mean(axis=1)
