"""Questions for how things stand are true of the apartment that they are made for."""

from benchmarks.relations.__main__ import EACH, ROWS, is_true, questions, staying
from egosplat_apartments.world.world import make_world


def test_questions_are_as_true_as_the_apartment_says_and_the_same_each_time():
    things = staying(make_world(seed=115, seconds=28.0, objects=28, motion=0.87, world="busy"))
    names = sorted({thing.kind.category for thing in things})
    asked = list(questions(things, names))
    assert (
        asked == list(questions(things, names))
        and [truth for _, truth in asked] == [True] * EACH + [False] * EACH
    )
    for words, truth in (
        (("cup", "on", ("coffee table",)), True),
        (("cup", "on", ("dining table",)), False),  # somebody carries that one
        (("television", "on", ("tv stand",)), True),
        (("tv stand", "under", ("television",)), True),
        (("cabinet", "next to", ("couch",)), False),
        (("coffee table", "between", ("armchair", "couch")), True),
    ):
        assert is_true(things, words) is truth, words
    assert len(ROWS.read_text().splitlines()) == 1 + 14 * EACH
