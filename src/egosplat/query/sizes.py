"""How large things are, as evidence for what they are called (docs/answers.md#sizes)."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array

# What things measure, by general knowledge: a row for each kind of a word.
TABLE = Path(__file__).with_name("sizes.csv")

# Limits of what sizes add to the log-odds of a relevancy: a wrong size tells more than a right one.
LIMITS = -1.0, 0.7

# Heights [m] that the middle one of named things may have, the largest spread [log] of a unit, and of the things that tell it
# the least log-odds of the best name, and number.
_HEIGHTS, _MOST_SPREAD, _NAMED, _LEAST_NAMED = np.geomspace(0.01, 30, 321), 0.25, 1.0, 12


@dataclass(frozen=True, eq=False)
class Sizes:
    """What sizes tell of N Gaussians at L levels: the instance of each, (N, L) int64, -1 for none, and the (W + 1, I + 1) logarithms of
    ``log_ratios``."""

    instance: Tensor
    ratios: Array

    def told(self, phrases: Sequence[str], weight: float) -> Array:
        """(Q, I + 1) float64 what the sizes of instances, none the last, add to the log-odds of relevancies to Q phrases."""
        return np.clip(weight * self.ratios[[*map(row_of, phrases)]], *LIMITS)

    def weigh(self, relevancy: Tensor, phrases: Sequence[str], weight: float) -> Tensor:
        """(Q, L, N) float32 relevancies in [0, 1] to Q phrases with what sizes add to their log-odds; 0 and 1 stay."""
        less = torch.from_numpy(np.exp(-self.told(phrases, weight))).to(relevancy)[:, self.instance.T]
        return torch.where(relevancy > 0, relevancy / (relevancy + (1.0 - relevancy) * less), 0.0)


@cache
def read_sizes() -> tuple[tuple[str, ...], Array]:
    """The words of ``TABLE`` and its (K, 7) float64 rows: index of the word, height, longer and shorter side [m], their spread [log],
    height of the foot above the floor and its spread [m]."""
    with TABLE.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.reader(lines))[1:]
    words = tuple(dict.fromkeys(row[0] for row in rows))
    return words, np.array([[words.index(word), *numbers] for word, *numbers in rows], np.float64)


def row_of(phrase: str) -> int:
    """The index of the longest word of ``TABLE`` with which a phrase ends; -1 for none."""
    table = read_sizes()[0]
    ends = [row for row, word in enumerate(table) if f" {phrase.lower()}".endswith(f" {word}")]
    return max(ends, key=lambda row: len(table[row]), default=-1)


def log_ratios(extents: Array) -> Array:
    """(W + 1, I + 1) float64 logarithm of how much more probable (I, 5) extents [m] are for each word of ``TABLE`` than for any; 0 where
    they are unknown, and in the last row and column, for no word and no instance."""
    density = _log_densities(np.nan_to_num(extents, nan=0.0))
    ratios = density - np.logaddexp.reduce(density, axis=0) + np.log(len(density))
    return np.pad(np.where(np.isnan(extents[:, 0]), 0.0, ratios), ((0, 1), (0, 1)))


def estimate_unit(extents: Array, phrases: Sequence[str], odds: Array) -> tuple[float, float] | None:
    """The unit [m] in which (I, 5) extents are most probable for things with (P, I) log-odds to be what phrases mean, and its
    spread [log]; None where few things are named, or many units are as probable."""
    rows = np.array([*map(row_of, phrases)])
    odds = odds[rows >= 0]
    kept = ~np.isnan(extents[:, 0]) & (odds.max(axis=0, initial=-np.inf) > _NAMED)
    if kept.sum() < _LEAST_NAMED or not (middle := np.median(extents[kept, 0])) > 0:
        return None
    log_p, units = 2 * odds[:, kept] - np.logaddexp.reduce(2 * odds[:, kept]), np.log(_HEIGHTS / middle)
    # Foot, of half weight, and top are lengths, whose density has a unit; those of the sides are of logarithms.
    fits = [log_p + _log_densities(extents[kept] * np.exp(one))[rows[rows >= 0]] + 1.5 * one for one in units]
    # Parts of things tell the same: instances count as the root of their number.
    fit = np.logaddexp.reduce(fits, axis=1).sum(axis=1) / np.sqrt(kept.sum())
    mean = np.average(units, weights=(p := np.exp(fit - fit.max())))
    spread = np.sqrt(np.average((units - mean) ** 2, weights=p))
    return (float(np.exp(mean)), float(spread)) if spread < _MOST_SPREAD else None


def _log_densities(extents: Array) -> Array:
    """(W, I) logarithm of the density of (I, 5) extents [m] for each word of ``TABLE``."""
    rows = read_sizes()[1]
    kind, tall, wide, deep, spread, stands, shift = rows.T[..., None]
    height, long, short, foot, top = extents.T
    sides, spread = np.log(0.01 + np.stack([tall, wide, deep])), np.hypot(spread, 0.15)
    # What is seen in part is smaller, and its foot may be hidden. A centimeter more is the thickness of Gaussians.
    seen = np.log(0.01 + np.stack([height, long, short]))[:, None] - sides
    density = _log_density(seen[:2], spread, 2.0, 1.0).sum(axis=0)
    density += 0.5 * _log_density(seen[2], 1.3 * spread, 3.0, 1.0)
    density += _log_density(top - stands - tall, np.hypot(np.hypot(shift, spread * tall), 0.05), 1.0, 1.0)
    density += 0.5 * _log_density(foot - stands, np.hypot(shift, 0.08), 1.0, 2.0)
    _, begin, kinds = np.unique(kind, return_index=True, return_counts=True)
    return np.logaddexp.reduceat(density, begin) - np.log(kinds)[:, None]


def _log_density(offset: Array, spread: Array, below: float, above: float) -> Array:
    """Logarithm of a normal density whose spread is wider by a factor below and above."""
    # Masks are merged, and show parts: what is far off tells no more against a word.
    z = np.clip(offset / (spread * np.where(offset < 0, below, above)), -3.0, 3.0)
    return -0.5 * z * z - np.log(spread * (below + above) / 2)
