"""Means with confidence intervals, from a few runs with different seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from scipy import stats

# The values of one measure of one point, one per run.
Sample = tuple[float, ...]


@dataclass(frozen=True)
class Estimate:
    """A value with the bounds of its interval; the bounds are None without repeated runs."""

    mean: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Chance:
    """Variance of a single run, NaN if no point was run twice, and its degrees of freedom."""

    variance: float
    freedom: int


def pool(samples: Sequence[Sample], step: float = 0.0) -> Chance:
    """Pool the variance within all points, as in analysis of variance.

    Args:
        step: resolution of the measure, such as 1 / queries for an accuracy; 0 for a continuous measure.
    """
    # A few runs per point give a usable variance only together. This assumes about the same variance in all points.
    # Equal continuous samples, such as the PSNR of points that share their Gaussians, are the same runs: they count once.
    known = samples if step else list(dict.fromkeys(samples))
    freedom = sum(len(one) - 1 for one in known)
    if not freedom:
        return Chance(math.nan, 0)
    squares = math.fsum((value - fmean(one)) ** 2 for one in known for value in one)
    # Equal accuracies can still differ by less than a step: the variance is at least that of rounding.
    return Chance(max(squares / freedom, step**2 / 12), freedom)


def estimate_mean(sample: Sample, chance: Chance, confidence: float, logarithmic: bool = False) -> Estimate:
    """Mean with Student's interval, one of ratios if ``chance`` is that of the logarithms of positive values."""
    mean = fmean(sample)
    if not chance.freedom:
        return Estimate(mean)
    student = float(stats.t.ppf((1 + confidence) / 2, chance.freedom))
    half = student * math.sqrt(chance.variance / len(sample))
    if logarithmic:
        return Estimate(mean, mean * math.exp(-half), mean * math.exp(half))
    return Estimate(mean, mean - half, mean + half)


def find_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto front of (cost, gain), by increasing cost: all others cost more, gain less, or are equal."""
    # By increasing cost, a point is on the front if it gains more than all cheaper ones.
    order = sorted(range(len(points)), key=lambda index: (points[index][0], -points[index][1]))
    found: list[int] = []
    for index in order:
        if not found or points[index][1] > points[found[-1]][1] or points[index] == points[found[-1]]:
            found.append(index)
    return found
