"""The queries of a scene's evaluation frames, with the ground truth of each phrase."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.open_vocabulary.colours import Shares, is_doubtful, main_colour
from benchmarks.open_vocabulary.phrases import colour_phrases, synonym_phrases
from egosplat.evaluation.queries import InstanceMap, Query

# Names of the sets of targets.
TARGETS = WORDS, COLOURED, TOLD_APART = (
    "things of a category",
    "things of a colour",
    "things of a colour beside others of their category",
)


@dataclass(frozen=True)
class Question:
    """A phrase with its truth in one frame.

    Attributes:
        targets: one of ``WORDS``, ``COLOURED`` and ``TOLD_APART``.
        kind: of the phrase, see ``benchmarks.open_vocabulary.phrases``.
        category: of the things: the cluster.
        colour: of the things, or None.
        query: the phrase as its category, and the instances that it means as the group ``all``.
    """

    targets: str
    kind: str
    category: str
    colour: str | None
    query: Query


def find_questions(
    queries: Sequence[Query],
    maps: Mapping[int, InstanceMap],
    shares: Shares,
    min_area: float,
) -> list[Question]:
    """All phrases for all queries of the benchmark.

    Args:
        queries: of the benchmark, all with a group ``all``.
        maps: instance map of each frame.
        shares: (N, colours) of each instance, see ``colour_shares``.
        min_area: things of one colour are asked where they cover at least this share of the picture.
    """
    return [
        question
        for query in queries
        if "all" in query.instances
        for question in (*_words(query), *_coloured(query, maps[query.frame], shares, min_area))
    ]


def _words(query: Query) -> Iterator[Question]:
    for kind, phrases in synonym_phrases(query.category).items():
        for phrase in phrases:
            yield _question(WORDS, kind, query, None, phrase, query.instances["all"])


def _coloured(query: Query, instance_map: InstanceMap, shares: Shares, min_area: float) -> Iterator[Question]:
    """Of each colour that things of the category have, unless it is in doubt of one of them."""
    every = query.instances["all"]
    colours = {one: main_colour(shares[one]) for one in every}
    for colour in sorted({colour for colour in colours.values() if colour}):
        own = tuple(one for one in every if colours[one] == colour)
        large = np.isin(instance_map, own).sum() >= min_area * instance_map.size
        if not large or any(is_doubtful(shares[one], colour) for one in every):
            continue
        for kind, phrase in colour_phrases(colour, query.category).items():
            yield _question(COLOURED, kind, query, colour, phrase, own)
            if len(own) < len(every):
                yield _question(TOLD_APART, kind, query, colour, phrase, own)


def _question(
    targets: str, kind: str, query: Query, colour: str | None, phrase: str, instances: tuple[int, ...]
) -> Question:
    asked = Query(query.row, query.frame, phrase, {"all": instances})
    return Question(targets, kind, query.category, colour, asked)
