"""Measure what tells whether things are what a query means."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from egosplat.query.answers import Thing
from egosplat.query.grades.calibration import Evidence, log_odds
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts
from egosplat.query.things import Surface

# Cosine from which a word means what the query means: "fridge" and "refrigerator", "lamp" and "desk lamp".
SYNONYM = 0.7

# A share of a view below it counts as this much.
_LEAST_SHARE = 1e-9


def measure_evidence(
    scene: QueryScene,
    surface: Surface,
    things: Sequence[Thing],
    query: Texts,
    words: Texts,
    temperature: float,
) -> list[Evidence]:
    """Measure for each thing the evidence that it is what a query means.

    Args:
        things: the best things that match the query, two or more if there are: each is compared with the others.
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
    scores, measured = [thing.score for thing in things], []
    for row, thing in enumerate(things):
        apart = thing.score - max(scores[:row] + scores[row + 1 :], default=0.0)
        measured.append(
            Evidence(_size(surface, thing), _lead(scene, surface, thing, texts, temperature), apart)
        )
    return measured


def other_meanings(query: Texts, words: Texts) -> Tensor:
    """(W,) bool, the words that do not mean the same as the one query."""
    return words.queries @ query.queries[0] < SYNONYM


def _size(surface: Surface, thing: Thing) -> float:
    shown = float(surface.shares[:, thing.members].sum(axis=1, dtype=np.float64).max())
    return math.log(max(shown, _LEAST_SHARE))


def _lead(scene: QueryScene, surface: Surface, thing: Thing, texts: Texts, temperature: float) -> float:
    """Lead of the first of the texts over the others, which compete with it."""
    level = surface.levels.index(thing.level)
    rows = torch.from_numpy(thing.members).to(scene.code.device)
    code, share = (values[rows, level][:, None] for values in (scene.code, scene.share))
    relevancy = replace(scene, code=code, share=share).relevancy(texts, temperature)[:, 0].cpu().numpy()
    weight = surface.weight[thing.members, level].astype(np.float64)
    fit, *others = map(log_odds, relevancy @ weight / weight.sum())
    return fit - max(others, default=0.0)
