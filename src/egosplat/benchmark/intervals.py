"""How far a score could be chance: confidence intervals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_NUMBERS_AT_ONCE = 2**22


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


@dataclass(frozen=True)
class Interval:
    """Bounds of a score; NaN where there are too few values for any."""

    low: float
    high: float


def wilson_interval(hits: int, count: int, confidence: float) -> Interval:
    """Of a share of independent hits (Wilson 1927), also near 0 and 1; NaN of none."""
    if not count:
        return Interval(float("nan"), float("nan"))
    found = stats.binomtest(hits, count).proportion_ci(confidence, method="wilson")
    return Interval(float(found.low), float(found.high))


def bootstrap_interval(values: NDArray[np.floating], options: IntervalOptions) -> Interval:
    """Of the mean of (P,) values, by percentiles of resampled means (Efron 1979); NaN of fewer than two.

    Pairs of one frame have much in common, which resampling pairs does not see: over few frames the true interval
    is wider.
    """
    if len(values) < 2:
        return Interval(float("nan"), float("nan"))
    found = stats.bootstrap(
        (values,),
        np.mean,
        n_resamples=options.resamples,
        batch=max(1, _NUMBERS_AT_ONCE // len(values)),
        confidence_level=options.confidence,
        method="percentile",
        rng=np.random.default_rng(options.seed),
    ).confidence_interval
    return Interval(float(found.low), float(found.high))
