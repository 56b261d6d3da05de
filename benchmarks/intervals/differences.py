"""A test of paired differences of scores over categories and scenes."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from egosplat.evaluation.intervals import (
    CONFIDENCE,
    RESAMPLES,
    SAME,
    SEED,
    Clusters,
    clustered_interval,
    mean_of_scenes,
)

# Signs of so many clusters or fewer are flipped in all ways; those of more, as often as the bootstrap resamples.
_ALL_WAYS = 14


class Difference(NamedTuple):
    """A mean paired difference, those that are not rejected, p of none, and Student's interval of the scenes' means if wider."""

    mean: float
    interval: tuple[float, float]
    p: float
    over_scenes: tuple[float, float] | None


def paired_difference(scenes: Sequence[Clusters], resamples: int = RESAMPLES) -> Difference:
    """Test ``mean_of_scenes`` of differences, -1..1, by flips of the signs of each scene's categories (docs/method.md#differences).

    The interval has zero exactly when p is at least 1 - confidence. Both are on these scenes; ``over_scenes`` is on others.
    """
    scenes = [scene for scene in scenes if len(scene.counts)]
    mean, means = mean_of_scenes(scenes), np.array([scene.mean for scene in scenes])
    low, high = _halves(scenes, resamples)
    rank = math.ceil(round((1 - CONFIDENCE) * len(low), 6)) - 1
    bounds, p = (np.sort(low)[rank], -np.sort(-high)[rank]), float(np.mean((low <= 0) & (high >= 0)))
    # Flips of equal differences have no spread: as in ``clustered_interval``, other categories may differ.
    shares = np.concatenate([np.zeros(0), *(scene.totals / scene.counts for scene in scenes)])
    alike = len(shares) and np.ptp(shares) <= SAME
    if alike and (doubt := clustered_interval(scenes, resamples, least=-1.0)):
        bounds = (min(bounds[0], doubt[0]), max(bounds[1], doubt[1]))
        p = max(p, 2 * float(stats.norm.sf(math.sqrt(len(shares) * abs(mean)))))
    if len(means) < 2:
        return Difference(mean, _within(bounds), p, None)
    half = stats.t.ppf((1 + CONFIDENCE) / 2, len(means) - 1) * stats.sem(means)
    own, student = _within(bounds), _within((mean - half, mean + half))
    return Difference(mean, own, p, student if np.ptp(student) > np.ptp(own) else None)


def _within(bounds: tuple[float, float]) -> tuple[float, float]:
    low, high = np.clip(bounds, -1, 1).tolist()
    return low, high


def _halves(scenes: Sequence[Clusters], resamples: int) -> NDArray[np.float64]:
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
        flipped = np.random.default_rng(SEED).integers(2, size=(resamples, len(clusters)))
        flipped[0], flipped[:, -1] = 0, 0
    ours = flipped @ clusters
    with np.errstate(invalid="ignore"):
        halves = np.stack([half[:, 0] / half[:, 1] for half in (ours, clusters.sum(axis=0) - ours)])
    # Rounded, so that ties are ties on every processor.
    return np.where(flipped.any(axis=1), np.sort(np.round(halves, 9), axis=0), [[-np.inf], [np.inf]])
