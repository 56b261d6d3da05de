"""Means with confidence intervals, from a few runs with different seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy import stats


@dataclass(frozen=True)
class Estimate:
    """A value with the bounds of its interval; the bounds are None without repeated runs."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Sample:
    """The values of one measure of one point, one per run.

    Attributes:
        values: at least one value.
        step: resolution of the measure, such as 1 / queries for an accuracy; 0 for a continuous measure.
    """

    values: tuple[float, ...]
    step: float = 0.0

    @property
    def mean(self) -> float:
        return math.fsum(self.values) / len(self.values)

    @property
    def squares(self) -> float:
        """Sum of squared differences from the mean."""
        mean = self.mean
        return math.fsum((value - mean) ** 2 for value in self.values)

    @property
    def logarithms(self) -> "Sample":
        """The sample of the logarithms of positive values."""
        return Sample(tuple(math.log(value) for value in self.values))


@dataclass(frozen=True)
class Chance:
    """Random differences between runs of one point.

    Attributes:
        variance: variance of a single run; NaN if no point was run twice.
        freedom: degrees of freedom of the variance.
    """

    variance: float
    freedom: int

    def interval(self, value: float, share: float, confidence: float) -> Estimate:
        """Student's interval of a value whose variance is ``share`` times that of a single run."""
        if self.freedom == 0:
            return Estimate(value)
        half = stats.t.ppf((1 + confidence) / 2, self.freedom) * math.sqrt(share * self.variance)
        return Estimate(value, value - half, value + half)


def pooled(samples: Sequence[Sample]) -> Chance:
    """Pool the variance within all points, as in analysis of variance."""
    # A few runs per point give a usable variance only together. This assumes about the same variance in all points.
    shares = [one for one in samples if one.step]
    # Equal continuous samples, such as the PSNR of points that share their Gaussians, are the same runs: they count once.
    known = shares + list(dict.fromkeys(one for one in samples if not one.step))
    freedom = sum(len(one.values) - 1 for one in known)
    if not freedom:
        return Chance(math.nan, 0)
    # Equal accuracies can still differ by less than a step: the variance is at least that of rounding.
    rounding = max(one.step for one in known) ** 2 / 12
    return Chance(max(math.fsum(one.squares for one in known) / freedom, rounding), freedom)


def mean(sample: Sample, chance: Chance, confidence: float) -> Estimate:
    """Mean with its interval."""
    return chance.interval(sample.mean, 1 / len(sample.values), confidence)


def positive_mean(sample: Sample, chance: Chance, confidence: float) -> Estimate:
    """Mean of positive values, with an interval of their ratio to it; ``chance`` is that of the logarithms."""
    bounds = chance.interval(0.0, 1 / len(sample.values), confidence)
    if bounds.low is None:
        return Estimate(sample.mean)
    return Estimate(sample.mean, sample.mean * math.exp(bounds.low), sample.mean * math.exp(bounds.high))


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto front of (cost, gain), by increasing cost.

    A point is on the front if every other point is more expensive, less good, or equal in both.
    """
    # By increasing cost, a point is on the front if it gains more than all cheaper ones.
    order = sorted(range(len(points)), key=lambda index: (points[index][0], -points[index][1]))
    found: list[int] = []
    for index in order:
        cost, gain = points[index]
        if not found or gain > points[found[-1]][1] or (cost, gain) == points[found[-1]]:
            found.append(index)
    return found
