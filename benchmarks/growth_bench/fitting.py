"""Laws of few terms, none of them negative, fitted to relative errors; and how wrong they are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Values = NDArray[np.float64]

Term = tuple[str, ...]
"""Names of the sizes that it is the product of; () is a constant."""


@dataclass(frozen=True)
class Fit:
    """A fitted law, ``sum of coefficient x product of sizes``.

    Attributes:
        coefficients: by term, at least 0.
        errors: of each point, (law - measured) / measured.
        left_out: the same of laws fitted without that point, which is predicted.
        without: those laws' coefficients.
    """

    coefficients: Mapping[Term, float]
    errors: tuple[float, ...]
    left_out: tuple[float, ...]
    without: tuple[Mapping[Term, float], ...]

    def at(self, sizes: Mapping[str, float]) -> float:
        """What the law says of a scene."""
        return evaluate(self.coefficients, sizes)

    def between(self, sizes: Mapping[str, float]) -> tuple[float, float]:
        """The least and the most that laws say which were fitted without one of the points."""
        found = [evaluate(law, sizes) for law in self.without]
        return min(found), max(found)


def evaluate(law: Mapping[Term, float], sizes: Mapping[str, float]) -> float:
    """The law's value; sizes of terms that are 0 need not be known."""
    return math.fsum(
        factor * math.prod(sizes[name] for name in term) for term, factor in law.items() if factor
    )


def fit(
    terms: Sequence[Term],
    sizes: Sequence[Mapping[str, float]],
    measured: Sequence[float],
    least: Mapping[Term, float] | None = None,
) -> Fit:
    """Fit a law to points.

    Args:
        terms: of the law; sizes: of each point; measured: what was, positive.
        least: what coefficients are at least; 0 of those that it does not have.

    Raises:
        ValueError: there are fewer points than two, or one is not positive.
    """
    values = np.asarray(measured, float)
    if len(values) < 2 or not (values > 0).all():
        raise ValueError("a law needs two points or more, all positive")
    design = np.array([[math.prod(own[name] for name in term) for term in terms] for own in sizes], float)
    floor = np.array([(least or {}).get(term, 0.0) for term in terms])
    weights = _solve(design, values, floor)
    others = [np.arange(len(values)) != index for index in range(len(values))]
    without = [_solve(design[rest], values[rest], floor) for rest in others]
    left_out = [float(row @ law / value - 1) for row, law, value in zip(design, without, values, strict=True)]
    return Fit(
        dict(zip(terms, weights.tolist(), strict=True)),
        tuple((design @ weights / values - 1).tolist()),
        tuple(left_out),
        tuple(dict(zip(terms, law.tolist(), strict=True)) for law in without),
    )


def _solve(design: Values, values: Values, floor: Values) -> Values:
    """Least squares of relative residuals, no coefficient below its floor; of a term that no point has, that."""
    relative = design / values[:, None]
    scale = relative.max(axis=0)
    scale[scale == 0] = 1.0
    return floor + nnls(relative / scale, 1.0 - relative @ floor)[0] / scale


def median_and_worst(errors: Sequence[float]) -> tuple[float, float]:
    """Of relative errors, whatever their sign."""
    sizes = np.abs(errors)
    return float(np.median(sizes)), float(sizes.max())
