"""Queries for present and absent things are separated by their scores, and the entry counts both."""

import numpy as np
import pytest

from egosplat.evaluation.presence import is_right, presence_entry, presence_phrases, separation
from egosplat.evaluation.queries import Query
from egosplat.frames.recording import Instance

NAMES = ["couch", "cup"]


@pytest.mark.parametrize(
    "present, absent, area",
    [
        ([0.9, 0.8], [0.1, 0.2], 1.0),
        ([0.1, 0.2], [0.9, 0.8], 0.0),
        ([0.5, 0.5], [0.5], 0.5),
        ([0.9, 0.3], [0.5, 0.1], 0.75),
    ],
)
def test_separation_is_the_share_of_pairs_in_the_right_order_ties_half(present, absent, area):
    assert separation(present, absent) == pytest.approx(area)


@pytest.mark.parametrize(
    "shares, category, right",
    [
        ([60.0, 20.0, 19.0], "couch", True),
        ([50.0, 20.0, 30.0], "couch", False),  # half is not more than half
        ([60.0, 20.0, 19.0], "cup", False),
        ([3.0, 0.0, 0.0], "couch", None),  # too little is seen
        ([60.0, 0.0, 0.0], "bed", None),
    ],
)
def test_an_answer_is_right_if_most_of_it_is_the_category(shares, category, right):
    assert is_right(np.array(shares), NAMES, category) is right


def test_phrases_of_the_recording_are_no_negatives():
    # No evaluation frame shows the bed.
    instances = [
        Instance(number, name, name, "static", "object") for number, name in enumerate(("couch", "bed"))
    ]
    queries = [Query(0, 0, "couch", {"all": (0,)}), Query(1, 4, "couch", {"all": (0,)})]
    assert presence_phrases(queries, instances, ["bed", "piano", "couch"]) == (["couch"], ["piano"])


def test_the_entry_counts_answers():
    """What is not found is never right, and best guesses count apart; untaught words do not count in the separation."""

    def query(phrase, present, score, grade, right=None, untaught=False):
        told = {"phrase": phrase, "present": present, "score": score, "grade": grade}
        return told | {"answered": grade == "found", "right": right, "untaught": untaught}

    asked = [
        query("couch", True, 0.9, "found", True),
        query("cup", True, 0.8, "found", None),
        query("bed", True, 0.3, "not found", True),
        query("desk", True, 0.3, "best guess", True),
        query("lamp", True, 0.3, "best guess", False),
        query("piano", False, 0.7, "found"),
        query("bicycle", False, 0.7, "best guess"),
        query("zeppelin", False, 1.0, "not found", untaught=True),
    ]
    entry = presence_entry(asked, 0.5)
    present = {"asked": 5, "answered": 2, "right": 1, "unverified": 1, "guessed": 2, "guessed_right": 1}
    assert entry["present"] == present
    assert entry["absent"] == {"asked": 3, "answered": 1, "untaught": 1, "guessed": 1}
    assert entry["separation"] == pytest.approx(0.4) and len(entry["queries"]) == 8
