"""How large things are, as evidence for what they are called (docs/method.md#sizes)."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from egosplat.geometry import Array

# What things measure, by general knowledge: a row for each kind of a word.
TABLE = Path(__file__).with_name("sizes.csv")

# Limits of what sizes add to the log-odds of a relevancy: a wrong size tells more than a right one.
LIMITS = -1.0, 0.7

# Quantiles of the extents of an instance, and of the heights of all its Gaussians for the height of the floor.
_EXTENT, _FLOOR = (0.04, 0.96), 0.01

# Minimum number of Gaussians of an instance whose extents are known.
_LEAST_GAUSSIANS = 16

# Standard deviations from which a measure tells no more against a word: masks are merged, and show parts.
_FARTHEST = 3.0


@dataclass(frozen=True, eq=False)
class Sizes:
    """What the sizes of I instances tell: the instance of each of N Gaussians at L levels, (N, L) int64, -1 for none; and (I, 5)
    float64 extents [m], see ``measure_extents``."""

    instance: Tensor
    extents: Array

    def of(self, rows: Tensor | slice, levels: slice) -> "Sizes":
        """The sizes of some Gaussians at some levels."""
        return replace(self, instance=self.instance[rows][:, levels])

    def told(self, phrases: Sequence[str], weight: float) -> Array:
        """(I + 1, Q) float64 what sizes add to the log-odds of relevancies to Q phrases; the last row is that of no instance."""
        ratios = log_ratios(self.extents, [table_word(phrase) for phrase in phrases])
        return np.vstack([np.clip(weight * ratios, *LIMITS), np.zeros(len(phrases))])

    def weigh(self, relevancy: Tensor, phrases: Sequence[str], weight: float) -> Tensor:
        """(Q, L, N) float32 relevancies in [0, 1] to Q phrases with what sizes add to their log-odds; 0 and 1 stay."""
        against = torch.from_numpy(np.exp(-self.told(phrases, weight))).to(relevancy)
        less = against[self.instance].permute(2, 1, 0)
        return torch.where(relevancy > 0, relevancy / (relevancy + (1.0 - relevancy) * less), 0.0)


def measure_extents(xyz: Array, instance: NDArray[np.int32], touching: csr_array, up: Array) -> Array:
    """(I, 5) float64 extents of instances, in the unit of (N, 3) centers: height, longer and shorter side of the footprint, and
    heights of foot and top above the floor; NaN where too few Gaussians show them.

    ``instance`` is (L, N), -1 for none. Only the largest set of Gaussians that touch, by an (N, N) matrix, counts; (3,) ``up`` has
    unit norm.
    """
    count = int(instance.max(initial=-1)) + 1
    extents = np.full((count, 5), np.nan)
    height = xyz @ up
    axes = np.linalg.svd(up[None])[2][1:]
    flat = xyz @ axes.T
    floor = np.quantile(height, _FLOOR) if len(height) else 0.0
    for own in instance:
        order = np.argsort(own, kind="stable")
        begin = np.searchsorted(own[order], np.arange(count + 1))
        for index in np.flatnonzero(np.diff(begin) >= _LEAST_GAUSSIANS):
            members = order[begin[index] : begin[index + 1]]
            label = connected_components(touching[members][:, members], directed=False)[1]
            members = members[label == np.bincount(label).argmax()]
            if len(members) >= _LEAST_GAUSSIANS:
                extents[index] = _measure(height[members] - floor, flat[members])
    return extents


def _measure(height: Array, flat: Array) -> Array:
    """(5,) extents of heights (M,) and places (M, 2) on the floor."""
    flat = flat - flat.mean(axis=0)
    along = flat @ np.linalg.eigh(flat.T @ flat)[1]
    short, long = np.ptp(np.quantile(along, _EXTENT, axis=0), axis=0)
    foot, top = np.quantile(height, _EXTENT)
    return np.array([top - foot, long, short, foot, top])


@cache
def read_sizes() -> tuple[dict[str, int], Array]:
    """The words of ``TABLE`` with the first of each one's rows, and the (K, 6) float64 rows: height, longer and shorter side [m],
    their spread [log], height of the foot above the floor and its spread [m]."""
    with TABLE.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.reader(lines))[1:]
    words = [row[0] for row in rows]
    return {word: words.index(word) for word in words}, np.array([row[1:] for row in rows], np.float64)


def table_word(phrase: str) -> str | None:
    """The longest word of ``TABLE`` with which a phrase ends."""
    words = phrase.lower().split()
    ends = (" ".join(words[first:]) for first in range(len(words)))
    return next((end for end in ends if end in read_sizes()[0]), None)


def log_ratios(extents: Array, words: Sequence[str | None]) -> Array:
    """(I, W) float64 logarithm of how much more probable extents [m] are for a word than for any; 0 where one of both is unknown."""
    densities, known = log_densities(extents), list(read_sizes()[0])
    with np.errstate(invalid="ignore"):
        usual = np.logaddexp.reduce(densities, axis=0) - math.log(len(known))
    told = np.zeros((len(extents), len(words)))
    for column, word in enumerate(words):
        if word is not None:
            told[:, column] = densities[known.index(word)] - usual
    return np.nan_to_num(told, nan=0.0)


def log_densities(extents: Array) -> Array:
    """(W, I) float64 logarithm of the density of extents [m] for each word of ``TABLE``; NaN where they are unknown."""
    words, rows = read_sizes()
    tall, wide, deep, spread, stands, shift = rows.T[..., None]
    height, long, short, foot, top = np.where(np.isnan(extents[:, :1]), 0.0, extents).T
    spread = np.hypot(spread, 0.15)
    density = (
        _of_side(height, tall, spread, 2.0)
        + _of_side(long, wide, spread, 2.0)
        + 0.5 * _of_side(short, deep, 1.3 * spread, 3.0)
        + _of_height(top - stands - tall, np.hypot(np.hypot(shift, spread * tall), 0.05), 1.0)
        + 0.5 * _of_height(foot - stands, np.hypot(shift, 0.08), 2.0)
    )
    begin = [*words.values()]
    kinds = np.diff([*begin, len(rows)])
    density = np.logaddexp.reduceat(density, begin) - np.log(kinds)[:, None]
    return np.where(np.isnan(extents[:, 0]), np.nan, density)


def _of_side(seen: Array, usual: Array, spread: Array, below: float) -> Array:
    """Logarithm of the density of a side [m], whose spread below the usual is wider by a factor: a part may be all that is seen. A
    centimeter more is the thickness of Gaussians."""
    z = np.log((seen + 0.01) / (usual + 0.01)) / spread
    return _normal(np.where(z < 0, z / below, z)) - np.log(spread * (1 + below) / 2)


def _of_height(offset: Array, spread: Array, above: float) -> Array:
    """Logarithm of the density of the offset of a height [m], whose spread above is wider by a factor."""
    return _normal(np.where(offset > 0, offset / above, offset) / spread) - np.log(spread * (1 + above) / 2)


def _normal(z: Array) -> Array:
    return -0.5 * np.clip(z, -_FARTHEST, _FARTHEST) ** 2
