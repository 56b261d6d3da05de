"""The numbers of a query: when it is refused, how that is said, and its options."""

import math

import pytest
import torch

from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.query import grades
from egosplat.query.grades import FOUND, GUESS, NOT_FOUND, Calibration, Evidence, Grading
from egosplat.query.options import LANGSPLAT, QueryOptions
from egosplat.query.text import Texts, other_meanings

FIT = Calibration(-1.0, {"size": 0.25, "fit": 1.0, "apart": 2.0}, 0.7)


@pytest.mark.parametrize(
    "p, grade",
    [(2 / 3, FOUND), (0.6666, GUESS), (0.25, GUESS), (0.2499, NOT_FOUND), (1.0, FOUND), (0.0, NOT_FOUND)],
)
def test_a_probability_has_one_of_three_grades_and_is_shown_with_it(p, grade):
    grading = Grading(FIT, 0.78)
    assert grading.grade(p) == grade == grading.grade(float(grading.shown(p)))
    assert (grading.refusal(p) is None) is (grade != NOT_FOUND) and "70%" in grading.notice


def test_the_probability_is_the_logistic_of_the_evidence():
    expected = 1 / (1 + math.exp(-(-1.0 - 0.25 * 4.0 + 3.0 + 2.0 * 0.5)))
    assert FIT.probability(Evidence(-4.0, 3.0, 0.5)) == pytest.approx(expected)
    assert [FIT.probability(Evidence(0.0, fit, 0.0)) for fit in (1e6, -1e6)] == [1.0, 0.0]


OTHERS = {"temperature": 5.0, "min_score": 0.5, "box_filter": 0.0, "segmentation_threshold": 0.5}
OTHERS |= {"canonical": ("thing",), "size_weight": 0.0, "name_weight": 0.0}


def test_a_fit_holds_for_its_openclip_and_its_keys_alone(monkeypatch):
    row = grades.held_keys(QueryOptions()) | {"intercept": "-1", "size": "2", "fit": "3", "apart": "4"}
    row |= {"present_share": "0.4", "misplaced": "0.2"}
    monkeypatch.setattr(grades, "read_fits", lambda: {"cafe": row})
    own = grades.grading_of("cafe", QueryOptions(present_share=0.4))
    assert own.calibration == Calibration(-1.0, {"size": 2.0, "fit": 3.0, "apart": 4.0}, 0.4)
    # Who asks of nothing that is absent meets the fifth of the errors that is on what is there.
    [sure] = [grades.grading_of("cafe", QueryOptions(present_share=1.0)).calibration]
    assert sure.intercept == pytest.approx(-1.0 + math.log(5))
    others = [("beef", {}), *(("cafe", {key: value}) for key, value in OTHERS.items())]
    for clip, keys in others:
        options = QueryOptions(**keys)
        grading = grades.grading_of(clip, options)
        assert grading == Grading(None, options.min_score) and "not calibrated" in grading.notice, keys


def test_the_bundled_openclip_has_a_fit_for_the_defaults():
    digest = model_hash(CLIP, {"clip_model": "small", "clip_checkpoint": "small"})
    assert digest in grades.read_fits() and grades.grading_of(digest, QueryOptions()).calibration is not None


@pytest.mark.parametrize(
    "phrase, others",
    [
        ("side table", {"bed", "couch", "cushion", "desk"}),
        ("table", {"bed", "couch", "cushion"}),
        ("couch", {"bed", "desk", "table"}),
        ("stable", {"bed", "couch", "cushion", "desk", "table"}),
    ],
)
def test_hypernyms_kinds_parts_and_synonyms_are_no_rivals(phrase, others):
    words = ("bed", "couch", "cushion", "desk", "table")
    queries = torch.eye(6)
    queries[3, 3:5] = torch.tensor([0.6, 0.8])  # a desk is called a table
    own = queries[words.index(phrase)] if phrase in words else torch.eye(6)[5]
    found = other_meanings(Texts((phrase,), own[None], own[None]), Texts(words, queries[:5], own[None]))
    assert {word for word, other in zip(words, found, strict=True) if other} == others


def test_filters_are_langsplats_at_any_size():
    squares = {1408: (30, 7), 1056: (22, 5), 512: (11, 3), 96: (2, 1), 1: (1, 1)}
    assert {side: (LANGSPLAT.box_filter_px(side), LANGSPLAT.majority_px(side)) for side in squares} == squares


@pytest.mark.parametrize(
    "score, least, expected",
    [
        (0.7797, 0.78, "0.77"),
        (0.78, 0.78, "0.78"),
        (0.7835, 0.784, "0.78"),
        (-1e-9, 0.0, "-0.01"),
        (math.nan, 0.5, "nan"),
        *((score, 0.785, None) for score in (0.77499, 0.7849, 0.785, 0.7851)),
        *((score, 0.775, None) for score in (0.77499, 0.7849)),
    ],
)
def test_a_score_is_shown_on_the_side_of_the_least_score(score, least, expected):
    grading = Grading(None, least)
    shown = grading.shown(score)
    assert expected in (None, shown)
    assert (float(shown) >= least) == (score >= least) == (grading.refusal(score) is None)
    assert grading.grade(score) == (FOUND if score >= least else NOT_FOUND)
