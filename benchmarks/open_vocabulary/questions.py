"""The queries of a scene's evaluation frames, with the ground truth of each phrase."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.open_vocabulary.colors import Shares, is_doubtful, main_color
from benchmarks.open_vocabulary.phrases import color_phrases, synonym_phrases
from egosplat.evaluation.queries import InstanceMap, Query

# Names of the sets of targets.
TARGETS = WORDS, COLORED, TOLD_APART = (
    "things of a category",
    "things of a color",
    "things of a color beside others of their category",
)


@dataclass(frozen=True)
class Question:
    """A phrase with its truth in one frame.

    Attributes:
        targets: one of ``WORDS``, ``COLORED`` and ``TOLD_APART``.
        kind: of the phrase, see ``benchmarks.open_vocabulary.phrases``.
        category: of the things: the cluster.
        color: of the things, or None.
        query: the phrase as its category, and the instances that it means as the group ``all``.
    """

    targets: str
    kind: str
    category: str
    color: str | None
    query: Query


def find_questions(
    queries: Sequence[Query], maps: Mapping[int, InstanceMap], shares: Shares, min_area: float
) -> list[Question]:
    """All phrases for all queries of the benchmark.

    Args:
        queries: of the benchmark, all with a group ``all``.
        maps: instance map of each frame.
        shares: (N, colors) of each instance, see ``color_shares``.
        min_area: things of one color are asked where they cover at least this share of the picture.
    """
    return [
        question
        for query in queries
        if "all" in query.instances
        for question in (*_words(query), *_colored(query, maps[query.frame], shares, min_area))
    ]


def _words(query: Query) -> Iterator[Question]:
    for kind, phrases in synonym_phrases(query.category).items():
        for phrase in phrases:
            yield _question(WORDS, kind, query, None, phrase, query.instances["all"])


def _colored(query: Query, instance_map: InstanceMap, shares: Shares, min_area: float) -> Iterator[Question]:
    """Of each color that things of the category have, unless it is in doubt of one of them."""
    every = query.instances["all"]
    colors = {one: main_color(shares[one]) for one in every}
    for color in sorted({color for color in colors.values() if color}):
        own = tuple(one for one in every if colors[one] == color)
        large = np.isin(instance_map, own).sum() >= min_area * instance_map.size
        if not large or any(is_doubtful(shares[one], color) for one in every):
            continue
        for kind, phrase in color_phrases(color, query.category).items():
            yield _question(COLORED, kind, query, color, phrase, own)
            if len(own) < len(every):
                yield _question(TOLD_APART, kind, query, color, phrase, own)


def _question(
    targets: str, kind: str, query: Query, color: str | None, phrase: str, instances: tuple[int, ...]
) -> Question:
    asked = Query(query.row, query.frame, phrase, {"all": instances})
    return Question(targets, kind, query.category, color, asked)
