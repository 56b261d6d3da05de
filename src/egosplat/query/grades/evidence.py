"""Measure what tells whether things are what a query means."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.query.answers import FoundThing
from egosplat.query.grades.calibration import Evidence, log_odds
from egosplat.query.scene_query import SceneIndex
from egosplat.query.text import Texts

# Cosine from which a word means what the query means: "fridge" and "refrigerator", "lamp" and "desk lamp".
SYNONYM = 0.7

# A share of a view below it counts as this much.
_LEAST_SHARE = 1e-9


def measure_evidence(
    index: SceneIndex,
    things: Sequence[FoundThing],
    levels: Sequence[str],
    query: Texts,
    words: Texts,
    temperature: float,
) -> list[Evidence]:
    """Measure for each thing the evidence that it is what a query means.

    Args:
        things: the best things that match the query, two or more if there are: each is compared with the others.
        levels: names of the levels.
        query: one query.
        words: names of things; each competes with the query, unless it means the same (see ``SYNONYM``).
        temperature: of the relevancy by which the things were found.
    """
    others = torch.nonzero(other_meanings(query, words))[:, 0].tolist()
    texts = replace(
        query,
        phrases=(*query.phrases, *(words.phrases[row] for row in others)),
        queries=torch.cat([query.queries, words.queries[others]]),
    )
    scores = [thing.score for thing in things]
    found = []
    for row, thing in enumerate(things):
        size, lead = _measure(index, levels.index(thing.level), thing.members, texts, temperature)
        found.append(Evidence(size, lead, thing.score - max(scores[:row] + scores[row + 1 :], default=0.0)))
    return found


def other_meanings(query: Texts, words: Texts) -> Tensor:
    """(W,) bool, the words that do not mean the same as the one query."""
    return words.queries @ query.queries[0] < SYNONYM


def _measure(
    index: SceneIndex, level: int, members: NDArray[np.int64], texts: Texts, temperature: float
) -> tuple[float, float]:
    """Size and lead of one thing for the first of the texts; the others compete with it."""
    rows = torch.from_numpy(members).to(index.scene.code.device)
    code, share = (values[rows, level][:, None] for values in (index.scene.code, index.scene.share))
    relevancy = replace(index.scene, code=code, share=share).relevancy(texts, temperature)[:, 0].cpu().numpy()
    weight = index.surface.weight[members, level].astype(np.float64)
    fit, *others = map(log_odds, relevancy @ weight / weight.sum())
    shown = float(index.surface.shares[:, members].sum(axis=1, dtype=np.float64).max())
    return math.log(max(shown, _LEAST_SHARE)), fit - max(others, default=0.0)
