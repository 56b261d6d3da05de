"""How things stand to each other, by boxes in 3D and gravity; lengths are relative to the things' own (docs/answers.md#relations)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np

from egosplat.geometry import Array, ground_axes
from egosplat.query.answers import Answer, Thing
from egosplat.query.grades import NOT_FOUND, Grading, judge
from egosplat.query.reading import Question, with_article
from egosplat.query.text import WORDS
from egosplat.query.things import EXTENT, Surface, extent_of

# Share of the smaller footprint that two things have in common where one is above the other.
_SHARED = 0.4
# How far a thing may be from what it lies on, as a share of its longest side; and from what it is next to, as a share of the
# geometric mean of both longest sides.
_TOUCHES, _NEXT = 0.25, 0.75
# Points of a thing below another or above it, from which its height there is known.
_LEAST_POINTS = 8


@dataclass(frozen=True, eq=False)
class Body:
    """A thing in axes whose third is up: (2, 3) corners of its box, and (M, 3) points of its surface, of which there may be none."""

    box: Array
    points: Array

    @cached_property
    def center(self) -> Array:
        """(3,) middle of the box."""
        return self.box.mean(axis=0)

    @cached_property
    def longest(self) -> float:
        """Its longest side."""
        return float((self.box[1] - self.box[0]).max())

    def inside(self, box: Array, axes: int = 3) -> Array:
        """(I, 3) of its points in a box, along the first axes."""
        low, high = box[:, :axes]
        return self.points[((self.points[:, :axes] >= low) & (self.points[:, :axes] <= high)).all(axis=1)]


def stands(relation: str, thing: Body, anchor: Body) -> bool:
    """Whether a thing is ``on``, ``under``, ``above``, ``in`` or ``next to`` an anchor, or hangs there, ``at`` it."""
    (low, high), (anchor_low, anchor_high) = thing.box, anchor.box
    reach = _TOUCHES * min(thing.longest, anchor.longest)
    wider = thing.box + [[-reach], [reach]]
    if relation == "at":
        return len(anchor.inside(wider)) >= _LEAST_POINTS
    common = np.minimum(high, anchor_high) - np.maximum(low, anchor_low)
    if relation == "in":
        inside = np.prod(common.clip(0.0)) >= 0.5 * np.prod(high - low)
        return bool(inside and (common >= 0).all() and thing.longest < anchor.longest)
    near = reach if relation == "above" else 0.0
    footprint = np.minimum(high - low, anchor_high - anchor_low)[:2] + near
    over = bool(np.prod((common[:2] + near).clip(0.0)) >= _SHARED * np.prod(footprint))
    if relation == "next to":
        gap = float(np.linalg.norm(common.clip(max=0.0)))
        return gap <= _NEXT * np.sqrt(thing.longest * anchor.longest) and not over
    if relation == "above":
        return over and bool(low[2] >= anchor_high[2] - near)
    # The seat of a couch is lower than its box, and so is a board of a bookcase.
    is_on, heights = relation == "on", anchor.inside(wider, axes=2)[:, 2]
    heights = heights[heights < thing.center[2] if is_on else heights > thing.center[2]]
    known = len(heights) >= _LEAST_POINTS
    height = np.quantile(heights, EXTENT[1] if is_on else 0.5) if known else anchor_high[2]
    if is_on:
        return over and bool(abs(low[2] - height) <= reach)
    return over and bool(thing.center[2] < anchor.center[2] and high[2] <= height + reach)


def is_between(thing: Body, one: Body, other: Body) -> bool:
    """Whether a thing stands near the line from one anchor to the other, seen from above, and behind neither."""
    line, offset = (other.center - one.center)[:2], (thing.center - one.center)[:2]
    along = float(offset @ line / max(line @ line, 1e-12))
    aside = float(np.linalg.norm(offset - along * line))
    return 0.1 < along < 0.9 and aside <= (one.longest + other.longest) / 4


def is_seen(relation: str, thing: Body, anchor: Body, view: Array) -> bool:
    """Whether a thing is left or right of an anchor, in front of it or behind it, for who stands upright at a (4, 4) camera_to_world
    in the axes of the bodies."""
    ahead = view[:2, 2] / max(float(np.linalg.norm(view[:2, 2])), 1e-12)
    axes = np.stack([(ahead[1], -ahead[0]), ahead])
    seen = [axes @ (one.center - view[:3, 3])[:2] for one in (thing, anchor)]
    (right, depth), (other_right, other_depth) = seen
    aside = right - other_right * (depth / other_depth if min(depth, other_depth) > 0 else 1.0)
    nearer = other_depth - depth
    by = {"left of": -aside, "right of": aside, "in front of": nearer, "behind": -nearer}
    return bool(by[relation] > _TOUCHES * min(thing.longest, anchor.longest))


@dataclass(frozen=True, eq=False)
class Space:
    """Where things are: what frames show of the Gaussians, the (3,) direction up, and the (F, 4, 4) camera_to_world of frames."""

    surface: Surface
    up: Array
    poses: Array
    _bodies: dict[Thing, Body] = field(default_factory=dict, init=False)

    @cached_property
    def axes(self) -> Array:
        """(3, 3) rotation whose rows are two horizontal axes, as near to the world's as can be, and up."""
        return np.vstack([ground_axes(self.up), self.up])

    def body(self, thing: Thing) -> Body:
        """The body of a thing, by the Gaussians that it is made of."""
        if thing not in self._bodies:
            points = self.surface.means[thing.members] @ self.axes.T
            weight = self.surface.weight[thing.members].max(axis=1).astype(np.float64)
            self._bodies[thing] = Body(extent_of(points, weight), points)
        return self._bodies[thing]

    def best_frame(self, things: Sequence[Thing]) -> int | None:
        """The frame that shows all of some things best; None if none shows all."""
        shown = np.min([self.surface.shares[:, one.members].sum(axis=1) for one in things], axis=0)
        return int(self.surface.frame[shown.argmax()]) if shown.max() > 0 else None

    def holds(self, relation: str, name: str, group: Sequence[Thing]) -> bool:
        """Whether the first thing of a group stands to the others, the first of which has a name."""
        thing, *anchors = map(self.body, group)
        if relation == "between":
            return is_between(thing, *anchors)
        if relation in ("left of", "right of", "in front of", "behind"):
            frame, turned = self.best_frame(group), np.eye(4)
            turned[:3, :3] = self.axes
            return frame is not None and is_seen(relation, thing, anchors[0], turned @ self.poses[frame])
        hangs = relation == "on" and name.split()[-1] in WORDS["hung"]
        return stands("at" if hangs else relation, thing, anchors[0])

    def related(self, relation: str, things: Sequence[Thing], anchors: Sequence[Answer]) -> Iterator[Thing]:
        """Yield the things that stand to one of each anchor's, "between" two of one anchor's, with the frame that shows them best."""
        choices = [anchor.things for anchor in anchors]
        pairs = relation == "between" and len(choices) == 1
        groups = [*(combinations(choices[0], 2) if pairs else product(*choices))]
        for thing in things:
            every = ([thing, *others] for others in groups if not any(same(thing, one) for one in others))
            holding = (group for group in every if self.holds(relation, anchors[0].phrase, group))
            if (group := next(holding, None)) is not None:
                frame, rated = self.best_frame(group), "score" if thing.probability is None else "probability"
                least = {rated: min(one.rating for one in group)}
                yield replace(thing, frame=thing.frame if frame is None else frame, **least)


def relate(
    question: Question, answers: Iterable[Answer], anchors: Sequence[Answer], grading: Grading, space: Space
) -> Iterator[Answer]:
    """Answer a question with all things that are found or guessed and stand as it asks, by the ``answers`` to its phrase, or to all words
    where it asks for anything, and by those to what it names beside."""
    lacking = next((one.refusal for one in anchors if one.untaught), None)
    named = zip(question.anchors, anchors, strict=True)
    absent = [asked.read for asked, anchor in named if not anchor.things]
    told = f"no {absent[0]} is found" if absent else f"none is seen {question.stand}"
    kept: list[Answer] = []
    for answer in answers if question.phrase or not absent else ():
        things = [one for one in answer.candidates if grading.grade(one.rating) != NOT_FOUND]
        if answer.refusal or absent:
            things = []
        elif question.relation:
            things = [*space.related(question.relation, things, anchors)]
        if things:
            kept.append(judge(answer.phrase, things, ((), None), grading, len(things)))
        elif question.phrase:
            why = lacking or answer.refusal or f"{with_article(answer.phrase)}, but {told}"
            if why != answer.refusal:
                answer = replace(answer, grade=NOT_FOUND, moving=None)
            kept.append(replace(answer, refusal=why, things=()))
    if not question.phrase:
        kept = _distinct(kept) or [Answer("", NOT_FOUND, 0.0, refusal=lacking or f"something, but {told}")]
    yield from kept


def _distinct(answers: Sequence[Answer]) -> list[Answer]:
    """The answers by decreasing rating, each thing once, by the name that fits it best; a room's own surfaces are no things."""
    kept: list[Answer] = []
    for answer in sorted(answers, key=lambda one: -one.rating):
        others = [thing for other in kept for thing in other.things]
        things = tuple(one for one in answer.things if not any(same(one, other) for other in others))
        if things and answer.phrase not in WORDS["shell"]:
            kept.append(replace(answer, things=things))
    return kept


def same(thing: Thing, other: Thing) -> bool:
    """Whether two things are one, found by two names."""
    common = len(np.intersect1d(thing.members, other.members, assume_unique=True))
    return common > 0.5 * min(len(thing.members), len(other.members))
