"""When a query is refused, and how that is said."""

import math
from dataclasses import replace

import pytest

from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query import grades as calibration
from egosplat.query.grades import (
    FOUND,
    GUESS,
    NOT_FOUND,
    Calibration,
    Evidence,
    Grading,
    grading_of,
    held_keys,
    read_fits,
)
from egosplat.query.options import QueryOptions
from egosplat.query.text import explain_untaught, untaught_words

FIT = Calibration(-1.0, {"size": 0.25, "lead": 1.0, "apart": 2.0}, found=0.62, guess=0.31)


@pytest.mark.parametrize("score, refused", [(0.549, True), (0.55, False), (1.0, False), (0.0, True)])
def test_the_limit_itself_is_an_answer(score, refused):
    grading = Grading(None, 0.55)
    assert (grading.refusal(score) is not None) is refused
    assert grading.grade(score) == (NOT_FOUND if refused else FOUND) and "0.55" in grading.notice


@pytest.mark.parametrize("words, count", [(["elephant", "elephant"], 1), (["elephant", "on"], 2)])
def test_words_outside_the_vocabulary_are_named_once(words, count):
    why = explain_untaught(words)
    assert why.count('"') == 2 * count and "never taught" in why


@pytest.mark.parametrize(
    "p, grade",
    [(0.62, FOUND), (0.6199, GUESS), (0.31, GUESS), (0.3099, NOT_FOUND), (1.0, FOUND), (0.0, NOT_FOUND)],
)
def test_a_probability_has_one_of_three_grades_and_is_shown_with_it(p, grade):
    grading = Grading(FIT, 0.78)
    assert grading.grade(p) == grade == grading.grade(float(grading.shown(p)))
    assert (grading.refusal(p) is None) is (grade != NOT_FOUND) and grading.notice is None


def test_the_probability_is_the_logistic_of_the_evidence():
    expected = 1 / (1 + math.exp(-(-1.0 - 0.25 * 4.0 + 3.0 + 2.0 * 0.5)))
    assert FIT.probability(Evidence(-4.0, 3.0, 0.5)) == pytest.approx(expected)
    assert (
        FIT.probability(Evidence(0.0, 1e6, 0.0)) == 1.0 and FIT.probability(Evidence(0.0, -1e6, 0.0)) == 0.0
    )


@pytest.mark.parametrize(
    "clip, key, value",
    [
        ("cafe", None, None),
        ("beef", None, None),
        *(
            ("cafe", *other)
            for other in {
                "temperature": 5.0,
                "min_score": 0.5,
                "box_filter": 0.0,
                "segmentation_threshold": 0.5,
                "canonical": ("thing",),
            }.items()
        ),
    ],
)
def test_a_fit_holds_for_its_openclip_and_its_keys_alone(monkeypatch, clip, key, value):
    row = held_keys(QueryOptions()) | {"intercept": "-1", "size": "2", "lead": "3", "apart": "4"}
    monkeypatch.setattr(calibration, "read_fits", lambda: {"cafe": row | {"found": "0.6", "guess": "0.3"}})
    options = QueryOptions() if key is None else QueryOptions(**{key: value})
    grading = grading_of(clip, options)
    if (clip, key) == ("cafe", None):
        assert grading.calibration == Calibration(-1.0, {"size": 2.0, "lead": 3.0, "apart": 4.0}, 0.6, 0.3)
    else:
        assert grading == Grading(None, options.min_score) and "not calibrated" in grading.notice


def test_the_bundled_openclip_has_a_fit_for_the_defaults(clip):
    digest = model_hash(CLIP, {"clip_model": "small", "clip_checkpoint": "small"})
    assert digest in read_fits() and grading_of(digest, QueryOptions()).calibration.found >= 0.5


@pytest.fixture(scope="module")
def clip():
    return load_open_clip("small", "small", "cpu", "float32")


@pytest.mark.parametrize(
    "phrase, words",
    [
        ("Green Bottle", []),
        ("wall-mounted coat rack", []),
        ("wooden elephant on a couch", ["elephant", "on"]),
        ("cup of tea", []),
    ],
)
def test_the_small_model_knows_its_own_words(clip, phrase, words):
    """words.txt lists what captions and glossary taught."""
    assert untaught_words(clip, phrase) == words


SYMBOLS = ["::", "%", "™", "😀", "👩\u200d🚀", "---", "_", "\u0308", "&amp;", "&#37;", "<>", "、。"]


@pytest.mark.parametrize("words", [None, frozenset({"chair"})])
@pytest.mark.parametrize("phrase", SYMBOLS)
def test_symbols_are_no_query(clip, phrase, words):
    """Not even with a published model, which lists no words, and at no score."""
    untaught = untaught_words(replace(clip, words=words), phrase)
    assert "no word" in explain_untaught(untaught)


@pytest.mark.parametrize("phrase", ["chair!", "ＣＨＡＩＲ", "(chair)", "chair 😀", "chair\u200b"])
def test_a_word_among_symbols_is_a_query(clip, phrase):
    assert untaught_words(clip, phrase) == []


@pytest.mark.parametrize("phrase", ["椅子", "стул", "כיסא", "2", "Ⅷ", "½"])
def test_letters_and_digits_of_any_script_are_words(clip, phrase):
    """A published model may know them; the small one does not."""
    assert untaught_words(replace(clip, words=None), phrase) == [] and untaught_words(clip, phrase)
