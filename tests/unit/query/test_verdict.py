"""When a query is refused, and how that is said."""

from dataclasses import replace

import pytest

from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.options import LANGSPLAT
from egosplat.query.text import untaught_words


@pytest.mark.parametrize("score, refused", [(0.549, True), (0.55, False), (1.0, False), (0.0, True)])
def test_the_limit_itself_is_an_answer(score, refused):
    assert (LANGSPLAT.change(min_score=0.55).refusal(score, []) is not None) is refused


def test_a_word_outside_the_vocabulary_is_rejected_at_any_score():
    why = LANGSPLAT.change(min_score=0.55).refusal(1.0, ["elephant", "elephant"])
    assert why.count('"elephant"') == 1 and "not trained on" in why


def test_a_limit_of_0_refuses_no_score():
    assert LANGSPLAT.change(min_score=0.0).refusal(0.0, []) is None


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


SYMBOLS = [
    "::",
    "%",
    "¿",
    "©",
    "™",
    "😀",
    "👩\u200d🚀",
    "...",
    "---",
    "_",
    '"',
    "$",
    "\u0308",
    "&amp;",
    "&#37;",
    "<>",
    "☃ ★",
    "、。",
]


@pytest.mark.parametrize("words", [None, frozenset({"chair"})])
@pytest.mark.parametrize("phrase", SYMBOLS)
def test_symbols_are_no_query(clip, phrase, words):
    """Not even with a published model, which lists no words, and at no score."""
    untaught = untaught_words(replace(clip, words=words), phrase)
    assert "no word" in LANGSPLAT.change(min_score=0.0).refusal(1.0, untaught)


@pytest.mark.parametrize("phrase", ["chair!", "ＣＨＡＩＲ", "(chair)", "chair 😀", "chair\u200b"])
def test_a_word_among_symbols_is_a_query(clip, phrase):
    assert untaught_words(clip, phrase) == []


@pytest.mark.parametrize("phrase", ["椅子", "стул", "כיסא", "2", "Ⅷ", "½"])
def test_letters_and_digits_of_any_script_are_words(clip, phrase):
    """A published model may know them; the small one does not."""
    assert untaught_words(replace(clip, words=None), phrase) == [] and untaught_words(clip, phrase)


def test_a_model_without_a_list_knows_all_words(clip):
    assert untaught_words(replace(clip, words=None), "zeppelin") == []
