"""What a few runs with different seeds tell: means, differences and ratios, with intervals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy import stats


@dataclass(frozen=True)
class Estimate:
    """A number, with the bounds of its interval; these are None where too few runs tell nothing of chance."""

    value: float
    low: float | None = None
    high: float | None = None

    def excludes(self, value: float) -> bool:
        """Whether the interval is known and ``value`` is outside of it."""
        return self.low is not None and not self.low <= value <= self.high


@dataclass(frozen=True)
class Sample:
    """A measure of one point, once a run.

    Attributes:
        values: at least one.
        step: the least by which it can differ, as 1 / queries of a share; 0 of what is continuous. Two runs that are
            equal differ by less than that, not by nothing.
    """

    values: tuple[float, ...]
    step: float = 0.0

    @property
    def mean(self) -> float:
        return math.fsum(self.values) / len(self.values)

    @property
    def variance(self) -> float:
        """Of a single run, estimated without bias; at least that of rounding to steps. NaN of one value."""
        if len(self.values) < 2:
            return math.nan
        mean = self.mean
        squares = math.fsum((value - mean) ** 2 for value in self.values)
        return max(squares / (len(self.values) - 1), self.step**2 / 12)


def mean(sample: Sample, confidence: float) -> Estimate:
    """The mean, with Student's interval."""
    count = len(sample.values)
    return _estimate(sample.mean, sample.variance / count, count - 1, confidence)


def difference(left: Sample, right: Sample, confidence: float) -> Estimate:
    """Mean of ``left`` minus mean of ``right``, with Welch's interval (Welch 1947), of unequal variances."""
    parts = [(one.variance / len(one.values), len(one.values) - 1) for one in (left, right)]
    variance = sum(part for part, _ in parts)
    value = left.mean - right.mean
    if math.isnan(variance) or variance == 0:
        return _estimate(value, variance, 1, confidence)
    freedom = variance**2 / sum(part**2 / count for part, count in parts)
    return _estimate(value, variance, freedom, confidence)


def ratio(left: Sample, right: Sample, confidence: float) -> Estimate:
    """Geometric mean of ``left`` over that of ``right``, with Welch's interval of the logarithms; of positive values."""
    found = difference(_logarithms(left), _logarithms(right), confidence)
    return Estimate(*(None if one is None else math.exp(one) for one in (found.value, found.low, found.high)))


def _logarithms(sample: Sample) -> Sample:
    return Sample(tuple(math.log(value) for value in sample.values))


def _estimate(value: float, variance: float, freedom: float, confidence: float) -> Estimate:
    if math.isnan(variance):
        return Estimate(value)
    half = stats.t.ppf((1 + confidence) / 2, freedom) * math.sqrt(variance)
    return Estimate(value, value - half, value + half)


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto front of (cost, gain): those than which none is both as cheap and as good, and better in
    one of the two. In order of their costs."""
    order = sorted(range(len(points)), key=lambda index: (points[index][0], -points[index][1]))
    found: list[int] = []
    for index in order:
        cost, gain = points[index]
        if not found or gain > points[found[-1]][1] or (cost, gain) == points[found[-1]]:
            found.append(index)
    return found
