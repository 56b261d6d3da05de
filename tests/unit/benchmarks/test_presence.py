"""The limit below which a query is refused: how it is chosen, and what it costs."""

import numpy as np

from benchmarks.presence.__main__ import Asked, gather, grouped

ASKED = Asked(
    present=np.array([0.9, 0.8, 0.7, 0.4]),
    right=np.array([True, True, False, True]),
    absent=np.array([0.75, 0.3, 0.2, 0.1]),
    untaught=2,
)


class Scene:
    """A scored scene with these queries."""

    def __init__(self, *rows: dict, validation: bool = False) -> None:
        self.validation = validation
        self.document = {"presence": {"queries": rows}}


def row(present: bool, score: float, right: bool | None = None, untaught: bool = False) -> dict:
    return {"present": present, "score": score, "right": right, "untaught": untaught}


def test_shares_at_a_limit():
    """A score at the limit is an answer; right answers are a share of what is there."""
    assert ASKED.shares(0.7) == (0.75, 0.5, 0.25)
    assert ASKED.shares(0.0) == (1.0, 0.75, 1.0) and ASKED.shares(1.01) == (0.0, 0.0, 0.0)


def test_the_limit_gains_most():
    """At 0.4 three right answers cost one false one; at 0.8 two cost none: the smaller of equal ones is taken."""
    assert ASKED.best_limit() == 0.4


def test_untaught_phrases_do_not_count_in_the_curve():
    asked = gather([Scene(row(True, 0.9, True), row(False, 1.0, untaught=True)), Scene(row(False, 0.2))])
    assert asked.untaught == 1 and asked.absent.tolist() == [0.2] and asked.right.tolist() == [True]


def test_no_limit_is_chosen_on_validation_apartments():
    """Validation apartments are recognized by name, in any order, and form a group of their own."""
    touched, validation = Scene(row(True, 0.9, True)), Scene(row(True, 0.4, True), validation=True)
    groups = grouped([validation, touched])
    assert {name: asked.present.tolist() for name, asked in groups.items()} == {
        "tuning": [0.9],
        "validation": [0.4],
    }
    assert list(grouped([validation])) == ["validation"]
