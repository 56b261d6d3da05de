"""How far a score could be chance: intervals over categories and scenes, and McNemar's test.

Queries of one category in one scene are one thing seen from several frames: they are hit or missed together. The
category is therefore what is resampled, never the query.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_SAME = 1e-12
"""Means of categories that differ by no more are equal but for rounding."""


@dataclass(frozen=True)
class IntervalOptions:
    """Which intervals are made.

    Attributes:
        confidence: such as 0.95.
        resamples: of the bootstrap.
        seed: of the bootstrap.
    """

    confidence: float
    resamples: int
    seed: int


RESAMPLING = IntervalOptions(confidence=0.95, resamples=10_000, seed=0)


@dataclass(frozen=True)
class Interval:
    """Lower and upper bound of a score."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Clusters:
    """The values of one scene's queries, summed by category.

    Attributes:
        totals: (K,) float64 sum of each category's values.
        counts: (K,) float64 number of each category's queries, at least 1.
    """

    totals: NDArray[np.float64]
    counts: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean over the queries; NaN of none."""
        count = self.counts.sum()
        return float(self.totals.sum() / count) if count else float("nan")


def cluster(values: Sequence[float], categories: Sequence[str]) -> Clusters:
    """Sum the values of a scene's queries by category.

    Args:
        values: (P,) of each query.
        categories: (P,) category of each query.
    """
    _, number = np.unique(np.asarray(categories, np.str_), return_inverse=True)
    return Clusters(
        np.bincount(number, weights=np.asarray(values, np.float64)), np.bincount(number).astype(np.float64)
    )


def mean_of_scenes(scenes: Sequence[Clusters]) -> float:
    """Plain mean of the scenes' means, as in the paper's tables; scenes without queries are left out."""
    means = [scene.mean for scene in scenes if len(scene.counts)]
    return math.fsum(means) / len(means) if means else float("nan")


def clustered_interval(
    scenes: Sequence[Clusters], options: IntervalOptions, least: float = 0.0, most: float = 1.0
) -> Interval | None:
    """Interval of ``mean_of_scenes``: how far other categories, and other scenes, could move it.

    Of one scene, categories are resampled with replacement, and the mean is their total over their number of queries.
    Of several, scenes are resampled first, then the categories of each drawn scene. The interval is the bootstrap's
    percentile interval, expanded for the small number K of categories in all: its tails are those of Student's
    distribution times sqrt(K / (K - 1)) (Hesterberg 2015, "What teachers should know about the bootstrap"). Of few scenes
    that differ by themselves it is too narrow; benchmarks/intervals/README.md says by how much.

    Of so few categories that even their smallest and largest cover less than the confidence (of six 97 %, of five 94 %),
    it is Student's interval around the mean, with the bootstrap's spread. Where all categories of all scenes have one
    mean, resampling shows no spread: then Wilson's interval of 0 in K bounds the share of categories that could differ,
    and each of these could be anything from ``least`` to ``most``.

    Args:
        scenes: their values.
        options: which interval is made.
        least, most: bounds of a value, such as -1 and 1 of a difference of hits.

    Returns:
        None where there are fewer than two categories: a single one tells nothing of others.
    """
    scenes = [scene for scene in scenes if len(scene.counts)]
    means = np.concatenate([scene.totals / scene.counts for scene in scenes]) if scenes else np.zeros(0)
    if len(means) < 2:
        return None
    if np.ptp(means) <= _SAME:
        return _interval_without_spread(float(means[0]), len(means), options.confidence, least, most)
    low, high = _bounds(scenes, len(means), options)
    return Interval(max(low, least), min(high, most))


def bounds_of(interval: Interval | None) -> tuple[float, float] | None:
    """The bounds as a pair, as in ``metrics.json``."""
    return None if interval is None else (interval.low, interval.high)


def scaled(bounds: Sequence[float] | None, factor: float) -> tuple[float, float] | None:
    """A pair of bounds in another unit."""
    return None if bounds is None else (factor * bounds[0], factor * bounds[1])


def _bounds(scenes: Sequence[Clusters], clusters: int, options: IntervalOptions) -> tuple[float, float]:
    resampled = _resampled(scenes, options)
    student = stats.t.ppf((1 + options.confidence) / 2, clusters - 1) * math.sqrt(clusters / (clusters - 1))
    if 2.0 ** (1 - clusters) > 1 - options.confidence:
        mean, half = mean_of_scenes(scenes), student * float(resampled.std())
        return mean - half, mean + half
    low, high = np.quantile(resampled, [stats.norm.sf(student), stats.norm.cdf(student)])
    return float(low), float(high)


def _resampled(scenes: Sequence[Clusters], options: IntervalOptions) -> NDArray[np.float64]:
    """(R,) means of resampled scenes and categories."""
    rng = np.random.default_rng(options.seed)
    shape = (options.resamples, len(scenes))
    drawn = rng.integers(len(scenes), size=shape) if len(scenes) > 1 else np.zeros(shape, np.int64)
    means = np.empty(shape)
    for number, scene in enumerate(scenes):
        places = drawn == number
        chosen = rng.integers(len(scene.counts), size=(np.count_nonzero(places), len(scene.counts)))
        means[places] = scene.totals[chosen].sum(axis=1) / scene.counts[chosen].sum(axis=1)
    return means.mean(axis=1)


def _interval_without_spread(
    value: float, clusters: int, confidence: float, least: float, most: float
) -> Interval:
    others = stats.binomtest(0, clusters).proportion_ci(confidence, method="wilson").high
    return Interval(value - others * (value - least), value + others * (most - value))
