"""Queries for present and absent things are separated by their scores, and the entry counts both."""

import numpy as np
import pytest

from egosplat.evaluation.presence import is_right, presence_entry, presence_phrases, separation
from egosplat.evaluation.queries import Query
from egosplat.frames.recording import Instance

NAMES = ["couch", "cup"]


@pytest.mark.parametrize("present, absent, area", [([0.5, 0.5], [0.5], 0.5), ([0.9, 0.3], [0.5, 0.1], 0.75)])
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


def test_phrases_of_the_recording_and_of_its_parts_are_no_negatives():
    # No evaluation frame shows the bed.
    instances = [
        Instance(number, name, name, "static", "object") for number, name in enumerate(("couch", "bed"))
    ]
    queries = [Query(0, 0, "couch", {"all": (0,)}), Query(1, 4, "couch", {"all": (0,)})]
    assert presence_phrases(queries, instances, ["bed", "piano", "couch", "pillow"]) == (["couch"], ["piano"])


def test_the_entry_counts_answers():
    """What is not found is never right, and best guesses count apart; untaught words do not count in the separation."""
    names = ("phrase", "present", "score", "grade", "right", "untaught")
    rows = [
        ("couch", True, 0.9, "found", True, False),
        ("cup", True, 0.8, "found", None, False),
        ("bed", True, 0.3, "not found", True, False),
        ("desk", True, 0.3, "best guess", True, False),
        ("lamp", True, 0.3, "best guess", False, False),
        ("piano", False, 0.7, "found", None, False),
        ("bicycle", False, 0.7, "best guess", None, False),
        ("zeppelin", False, 1.0, "not found", None, True),
    ]
    asked = [dict(zip(names, row, strict=True)) | {"answered": row[3] == "found"} for row in rows]
    entry = presence_entry(asked, 0.5)
    present = {"asked": 5, "answered": 2, "right": 1, "unverified": 1, "guessed": 2, "guessed_right": 1}
    assert entry["present"] == present
    assert entry["absent"] == {"asked": 3, "answered": 1, "untaught": 1, "guessed": 1}
    assert entry["separation"] == pytest.approx(0.4) and len(entry["queries"]) == 8
