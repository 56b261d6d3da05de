"""Bootstrap intervals of scores over categories and scenes, and one test of paired differences."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

# Means of categories that differ by less are equal up to rounding.
_SAME = 1e-12

# Signs of so many clusters or fewer are flipped in all ways; those of more, as often as the bootstrap resamples.
_ALL_WAYS = 14


@dataclass(frozen=True)
class IntervalOptions:
    """Options of the bootstrap."""

    confidence: float
    resamples: int
    seed: int


RESAMPLING = IntervalOptions(confidence=0.95, resamples=10_000, seed=0)


class Interval(NamedTuple):
    """Lower and upper bound."""

    low: float
    high: float


class Difference(NamedTuple):
    """A mean paired difference, those that are not rejected, p of none, and Student's interval of the scenes' means if wider."""

    mean: float
    interval: Interval
    p: float
    over_scenes: Interval | None


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
    scenes: Sequence[Clusters], options: IntervalOptions, least: float = 0.0, most: float = 1.0
) -> Interval | None:
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
    if np.ptp(means) <= _SAME:
        value = float(means[0])
        others = stats.binomtest(0, len(means)).proportion_ci(options.confidence, method="wilson").high
        return Interval(value - others * (value - least), value + others * (most - value))
    low, high = _bounds(scenes, len(means), options)
    return Interval(max(low, least), min(high, most))


def _bounds(scenes: Sequence[Clusters], clusters: int, options: IntervalOptions) -> tuple[float, float]:
    resampled = _resampled(scenes, options)
    # The percentiles are expanded for a small number K of categories: the tails are those of Student's distribution
    # times sqrt(K / (K - 1)) (Hesterberg 2015, "What teachers should know about the bootstrap").
    student = stats.t.ppf((1 + options.confidence) / 2, clusters - 1) * math.sqrt(clusters / (clusters - 1))
    # The smallest and the largest of a few categories cover less than the confidence (of five, 94 %). Student's interval
    # with the bootstrap's standard deviation replaces the percentiles.
    if 2.0 ** (1 - clusters) > 1 - options.confidence:
        mean, half = mean_of_scenes(scenes), float(student * resampled.std())
        return mean - half, mean + half
    low, high = np.quantile(resampled, [stats.norm.sf(student), stats.norm.cdf(student)])
    return float(low), float(high)


def _resampled(scenes: Sequence[Clusters], options: IntervalOptions) -> NDArray[np.float64]:
    """(R,) means of resampled scenes and categories: scenes first, then the categories of each drawn scene."""
    rng = np.random.default_rng(options.seed)
    shape = (options.resamples, len(scenes))
    # A single scene is drawn always, so its interval covers other categories only.
    drawn = rng.integers(len(scenes), size=shape) if len(scenes) > 1 else np.zeros(shape, np.int64)
    means = np.empty(shape)
    for index, scene in enumerate(scenes):
        here = drawn == index
        chosen = rng.integers(len(scene.counts), size=(np.count_nonzero(here), len(scene.counts)))
        means[here] = scene.totals[chosen].sum(axis=1) / scene.counts[chosen].sum(axis=1)
    return means.mean(axis=1)


def paired_difference(scenes: Sequence[Clusters], options: IntervalOptions = RESAMPLING) -> Difference:
    """Test ``mean_of_scenes`` of differences, -1..1, by flips of the signs of each scene's categories (docs/method.md#differences).

    The interval has zero exactly when p is at least 1 - confidence. Both are on these scenes; ``over_scenes`` is on others.
    """
    scenes = [scene for scene in scenes if len(scene.counts)]
    mean, means = mean_of_scenes(scenes), np.array([scene.mean for scene in scenes])
    low, high = _halves(scenes, options)
    rank = math.ceil(round((1 - options.confidence) * len(low), 6)) - 1
    bounds, p = (np.sort(low)[rank], -np.sort(-high)[rank]), float(np.mean((low <= 0) & (high >= 0)))
    # Flips of equal differences have no spread: as in ``clustered_interval``, other categories may differ.
    shares = np.concatenate([np.zeros(0), *(scene.totals / scene.counts for scene in scenes)])
    alike = len(shares) and np.ptp(shares) <= _SAME
    if alike and (doubt := clustered_interval(scenes, options, least=-1.0)):
        bounds = (min(bounds[0], doubt.low), max(bounds[1], doubt.high))
        p = max(p, 2 * float(stats.norm.sf(math.sqrt(len(shares) * abs(mean)))))
    if len(means) < 2:
        return Difference(mean, _within(bounds), p, None)
    half = stats.t.ppf((1 + options.confidence) / 2, len(means) - 1) * stats.sem(means)
    own, student = _within(bounds), _within((mean - half, mean + half))
    return Difference(mean, own, p, student if np.ptp(student) > np.ptp(own) else None)


def _within(bounds: tuple[float, float]) -> Interval:
    return Interval(*np.clip(bounds, -1, 1).tolist())


def _halves(scenes: Sequence[Clusters], options: IntervalOptions) -> NDArray[np.float64]:
    """(2, R) lower and higher weighted mean of the clusters whose signs are flipped and of the others.

    Flipped, a mean is as far from a supposed difference as the observed one, or farther, exactly when the difference lies
    between the two. The first flips none, which every difference allows.
    """
    sums = [np.stack([scene.totals, scene.counts], 1) / scene.counts.sum() for scene in scenes]
    clusters = np.concatenate([np.zeros((0, 2)), *sums])
    # The sign of the last stays: opposite flips have the same halves.
    if len(clusters) <= _ALL_WAYS:
        flipped = np.arange(2 ** max(len(clusters) - 1, 0))[:, None] >> np.arange(len(clusters)) & 1
    else:
        flipped = np.random.default_rng(options.seed).integers(2, size=(options.resamples, len(clusters)))
        flipped[0], flipped[:, -1] = 0, 0
    ours = flipped @ clusters
    with np.errstate(invalid="ignore"):
        halves = np.stack([half[:, 0] / half[:, 1] for half in (ours, clusters.sum(axis=0) - ours)])
    # Rounded, so that ties are ties on every processor.
    return np.where(flipped.any(axis=1), np.sort(np.round(halves, 9), axis=0), [[-np.inf], [np.inf]])
