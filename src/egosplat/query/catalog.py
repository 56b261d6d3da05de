"""What is in a scene: names of things of a home are asked at once, and each thing is told once (docs/look.md#catalog)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from egosplat.query.answers import Answer
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import NOT_FOUND
from egosplat.query.text import WORDS, is_kind, name_parts, untaught_words, words_to_try
from egosplat.query.things import SAME, Surface

# Things of one name, and other names of a thing, that are told at most.
_MANY, _ALSO = 8, 2

# Few of these names are in a home; a reader asks rather for what was seen.
_PRESENT_SHARE = 0.42

# What has less than this share of the Gaussians of what it lies in is another thing, or a part.
_PART = 0.3


def catalog(scene: Scene) -> list[Answer]:
    """Tell each thing of a scene once, in an answer of its own, by decreasing probability; then what moves or is carried about.

    Of names for the same Gaussians, or one instance, the best rated is told, or a kind of it with the same grade; a part is not told
    beside its whole. UserError: as ``Scene.ask``.
    """
    words = (*words_to_try(scene.clip), *WORDS["more"])
    names = [word for word in words if not untaught_words(scene.clip, word)]
    options = scene.options.change(present_share=_PRESENT_SHARE)
    answers, grading = [*scene.answers(names, _MANY, None, options)], scene.grading(options)
    claims = [
        Answer(answer.phrase, grade, thing.score, thing.probability, things=(thing,))
        for answer in answers
        for thing in answer.candidates
        if (grade := grading.grade(thing.rating)) != NOT_FOUND
    ]
    return [*merge(scene.surface, claims), *_unplaced(answers)]


def merge(surface: Surface, claims: Iterable[Answer]) -> list[Answer]:
    """Tell the things of some answers, each of which has one, once and under one name, see ``catalog``."""
    groups: list[list[Answer]] = []
    for claim in sorted(claims, key=lambda one: -one.rating):
        _group(surface, groups, claim)
    return [*map(_named, groups)]


def _group(surface: Surface, groups: list[list[Answer]], claim: Answer) -> None:
    """Add a claim to the group of which it is another name, or as a group of its own; but a part of what has a group gets none, and
    groups of its parts go."""
    own = claim.things[0].members
    instance = surface.instance_of(own)
    for group in [*groups]:
        other = group[0].things[0].members
        common, mine, theirs = map(surface.visible, (np.intersect1d(own, other), own, other))
        overlap, alike = common > SAME * min(mine, theirs), _PART < mine / theirs < 1 / _PART
        if (overlap and alike) or (instance >= 0 and instance == surface.instance_of(other)):
            group.append(claim)
            return
        part, whole = (claim, group[0]) if mine < theirs else (group[0], claim)
        if overlap and part.phrase in {whole.phrase, *name_parts([whole.phrase])}:
            if part is claim:
                return
            groups.remove(group)
    groups.append([claim])


def _named(group: Sequence[Answer]) -> Answer:
    """The first of a group, under the name of it that says most."""
    best, names = group[0], dict.fromkeys(one.phrase for one in group)
    kinds = [one.phrase for one in group if one.grade == best.grade and is_kind(one.phrase, best.phrase)]
    name = max(kinds, key=len)
    return replace(best, phrase=name, also=tuple(one for one in names if one != name)[:_ALSO])


def _unplaced(answers: Iterable[Answer]) -> Iterator[Answer]:
    """What moves or is carried about, and so has no place in 3D, each once under the name that fits it best."""
    groups: dict[Any, list[tuple[float, Answer]]] = {}
    for answer in answers:
        if moving := answer.moving:
            groups.setdefault(moving.tracks.tobytes(), []).append((moving.rating or 0.0, answer))
        elif carried := next(iter(answer.history), None):
            told = Answer(answer.phrase, NOT_FOUND, 0.0, refusal="carried about", history=answer.history)
            groups.setdefault((carried.from_s, carried.frame), []).append((carried.score, told))
    for group in groups.values():
        _, best = max(group, key=lambda one: one[0])
        yield replace(best, also=tuple(one.phrase for _, one in group if one is not best)[:_ALSO])
