"""How made-up things stand to each other, in worlds of any up direction."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from egosplat.query.answers import Answer, Thing
from egosplat.query.grades import FOUND, MOVING, NOT_FOUND, by_score
from egosplat.query.reading import Question
from egosplat.query.relations import Space, relate

# Centers and sides [m], the last upward; of the couch also its seat.
BOXES = {
    "table": ((0.0, 0.0, 0.72), (1.6, 0.8, 0.06)),
    "cup": ((0.3, 0.1, 0.8), (0.1, 0.1, 0.1)),
    "trash can": ((0.2, 0.0, 0.2), (0.3, 0.3, 0.4)),
    "couch": ((3.0, 0.0, 0.2), (2.0, 0.9, 0.4)),
    "pillow": ((3.0, 0.1, 0.5), (0.5, 0.4, 0.2)),
    "lamp": ((4.3, 0.0, 0.7), (0.3, 0.3, 1.4)),
    "bowl": ((-0.4, 0.0, 0.85), (0.3, 0.3, 0.2)),
    "ball": ((-0.4, 0.0, 0.85), (0.1, 0.1, 0.1)),
    "chair": ((1.5, 0.0, 0.4), (0.5, 0.5, 0.8)),
    "picture": ((3.0, 0.5, 1.5), (0.6, 0.04, 0.4)),
    "wall": ((3.0, 0.55, 1.3), (1.8, 0.04, 2.6)),
}
# What stands upright: +y is ahead of the wearer, +x to the right.
VIEW = np.array([[1.0, 0, 0, 1.5], [0, 0, 1.0, -4.0], [0, -1.0, 0, 1.2], [0, 0, 0, 1.0]])
AXES = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), "tilted": None}


@pytest.fixture(params=AXES)
def space(request):
    """A space of the boxes, whose members are points on their surfaces, in turned axes."""
    turn = AXES[request.param]
    if turn is None:
        turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
        turn[:, 0] *= np.linalg.det(turn)
    sides = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 12)] * 3), axis=-1).reshape(-1, 3)
    sides = sides[(np.abs(sides) == 0.5).any(axis=1)]
    points = [np.array(center) + sides * size for center, size in BOXES.values()]
    # The back of the couch is higher than its seat.
    points[3][points[3][:, 1] > 0.3, 2] += 0.5
    means = np.concatenate(points) @ turn.T
    shares = np.full((1, len(means)), 1e-4, np.float32)
    surface = SimpleNamespace(means=means, shares=shares, weight=shares.T, frame=np.array([0]))
    pose = np.eye(4)
    pose[:3] = turn @ VIEW[:3]
    return Space(surface, turn @ np.array([0.0, 0, 1]), pose[None])


def answer(space, name: str, grade: str = FOUND) -> Answer:
    count = len(space.surface.means) // len(BOXES)
    members = np.arange(count) + count * list(BOXES).index(name)
    thing = Thing(0.9, "whole", np.zeros(3), np.ones(3), 0, members)
    things = (thing,) if grade == FOUND else ()
    why = None if things else "not found: nothing"
    return Answer(name, grade, 0.9, None, why, things=things, candidates=(thing,))


def told(space, phrase: str, relation: str, *anchors: str) -> Answer:
    question = Question(phrase, relation, tuple(map(Question, anchors)))
    others = [answer(space, one) for one in anchors]
    return next(relate(question, [answer(space, phrase)], others, by_score(0.5), space))


RIGHT = """cup on table; trash can under table; pillow on couch; lamp next to couch; ball in bowl; picture on wall; bowl on table;
picture above couch; table under cup; cup left of lamp; lamp right of cup; pillow in front of wall; wall behind pillow;
chair next to table"""
WRONG = """cup on couch; cup under table; trash can on table; cup next to couch; table on cup; bowl in ball; lamp on couch;
pillow under couch; picture on table; lamp left of cup; lamp above table; bowl next to cup; wall in front of pillow"""
BOTH = (RIGHT, True), (WRONG, False)
CASES = [(text.strip(), right) for texts, right in BOTH for text in texts.split(";")]


@pytest.mark.parametrize("text, right", CASES)
def test_how_things_stand(space, text, right):
    [phrase] = [name for name in BOXES if text.startswith(name)]
    [anchor] = [name for name in BOXES if text.endswith(name)]
    found = told(space, phrase, text[len(phrase) : -len(anchor)].strip(), anchor)
    assert (found.grade == FOUND) is right is bool(found.things), text
    assert right or found.refusal.startswith(f"a {phrase}, but none is seen ")


def test_between_two_things_or_two_of_one_name(space):
    assert told(space, "chair", "between", "table", "couch").grade == FOUND
    assert told(space, "lamp", "between", "table", "couch").grade == NOT_FOUND
    both = answer(space, "table").things + answer(space, "couch").things
    pair = Answer("seat", FOUND, 0.9, things=both)
    asked = Question("chair", "between", (Question("seat"),)), [answer(space, "chair")]
    assert next(relate(*asked, [pair], by_score(0.5), space)).things[0].frame == 0


def test_what_is_absent_is_named_and_anything_is_listed_once(space):
    grading, table = by_score(0.5), [answer(space, "table")]
    question = Question("cup", "on", (Question("table"),))
    [lacking] = relate(question, [answer(space, "cup")], [answer(space, "table", NOT_FOUND)], grading, space)
    assert lacking.refusal == "a cup, but no table is found"
    [absent] = relate(question, [answer(space, "cup", NOT_FOUND)], table, grading, space)
    assert absent.refusal == "not found: nothing"
    seen, why = replace(answer(space, "cup", NOT_FOUND), grade=MOVING, moving="its times"), "never taught"
    untaught = [Answer("", NOT_FOUND, 0.0, refusal=why, untaught=("x",))]
    [unknown] = relate(question, [seen], untaught, grading, space)
    assert (unknown.grade, unknown.refusal, unknown.moving) == (NOT_FOUND, why, None)
    anything = Question("", "on", (Question("table"),))
    every = [answer(space, name) for name in (*BOXES, "cup")]
    assert {one.phrase for one in relate(anything, every, table, grading, space)} == {"cup", "bowl"}
    [nothing] = relate(anything, [answer(space, "lamp")], table, grading, space)
    assert nothing.refusal == "something, but none is seen on a table"
