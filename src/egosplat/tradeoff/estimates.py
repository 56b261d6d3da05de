"""What a few runs with different seeds tell: means with intervals."""

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
    def squares(self) -> float:
        """Sum of the squared differences from the mean."""
        mean = self.mean
        return math.fsum((value - mean) ** 2 for value in self.values)

    @property
    def logarithms(self) -> "Sample":
        """Of positive values."""
        return Sample(tuple(math.log(value) for value in self.values))


@dataclass(frozen=True)
class Chance:
    """How far runs of the same point differ.

    Attributes:
        variance: of a single run; NaN where no point was run twice.
        freedom: degrees of freedom of that estimate.
    """

    variance: float
    freedom: int

    def interval(self, value: float, share: float, confidence: float) -> Estimate:
        """A value whose variance is ``share`` of a single run's, with Student's interval."""
        if self.freedom == 0:
            return Estimate(value)
        half = stats.t.ppf((1 + confidence) / 2, self.freedom) * math.sqrt(share * self.variance)
        return Estimate(value, value - half, value + half)


def pooled(samples: Sequence[Sample]) -> Chance:
    """One variance for all points, that within each of them (of analysis of variance).

    Two runs of one point tell next to nothing of chance; two runs of each of ten points do, where chance is about as
    large in all of them. It is at least that of rounding to the largest step. Equal runs of what is continuous, as PSNR
    of points that share their Gaussians, are the same runs, and count once.
    """
    shares = [one for one in samples if one.step]
    known = shares + list(dict.fromkeys(one for one in samples if not one.step))
    freedom = sum(len(one.values) - 1 for one in known)
    if not freedom:
        return Chance(math.nan, 0)
    rounding = max(one.step for one in known) ** 2 / 12
    return Chance(max(math.fsum(one.squares for one in known) / freedom, rounding), freedom)


def mean(sample: Sample, chance: Chance, confidence: float) -> Estimate:
    """The mean with its interval."""
    return chance.interval(sample.mean, 1 / len(sample.values), confidence)


def positive_mean(sample: Sample, chance: Chance, confidence: float) -> Estimate:
    """The mean of positive values, with the bounds of a ratio to it; ``chance`` is that of logarithms."""
    bounds = chance.interval(0.0, 1 / len(sample.values), confidence)
    if bounds.low is None:
        return Estimate(sample.mean)
    return Estimate(sample.mean, sample.mean * math.exp(bounds.low), sample.mean * math.exp(bounds.high))


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
