"""Questions in words are read as the things that they ask for, and plain words as they are."""

from dataclasses import replace

import pytest

from egosplat.query.reading import read_questions
from egosplat.query.text import suggest

PLAIN = """cup; bed frame; chest of drawers; wall-mounted coat rack; tv stand; can opener; US map; things; 椅子; glass; bus;
scissors; glasses; shelves; clothes basket; black and white rug; person in red; ::; the"""
READ = """
cups | where is my cup? | Where's the CUP | find the cups | show me all of the cups, please = cup
is there a cup in this room? | ＷＨＥＲＥ is my cup | how many cups are there? | Hey, where's my cup = cup
bed, couch | bed and couch | where are the bed and the couch? | bed; couch = bed + couch
椅子、桌子 = 椅子 + 桌子
could you tell me where I left my keys = keys
cup on the table | cup on table | Is the cup on the table? | cups that stand on top of a table = cup on table
"cup" and “the book” = cup + the book
cup and book under the desk = cup under desk + book under desk
pillow between the couch and the armchair = pillow between couch and armchair
what is on the desk | what's on the desk? | show me everything on the desk = anything on desk
what's in this room? | what do you see? = anything
who was here? | is anybody there? = person
chair in front of the desk = chair in front of desk
lamp to the left of the cup next to the bed = lamp left of cup next to bed
chairs by the table = chair next to table
"cup on the table" = cup on the table
"""
ROWS = [row.split(" = ") for row in READ.strip().split("\n")]
CASES = [(text, expected) for texts, expected in ROWS for text in texts.split(" | ")]


def reads(clip, text: str, names=()) -> list[str]:
    return [question.read.lower() for question in read_questions(clip, text, names)]


@pytest.mark.parametrize("text, expected", CASES)
def test_a_question_is_read_as_what_it_asks_for(clip, text, expected):
    assert reads(clip, text) == expected.split(" + ")
    assert all(question.typed == text for question in read_questions(clip, text))


@pytest.mark.parametrize("text", [text.strip() for text in PLAIN.split(";")])
def test_plain_words_and_fixed_names_are_asked_as_typed(clip, text):
    for model in (clip, replace(clip, words=None)):
        [question] = read_questions(model, text)
        assert question.phrase == text == question.read and question.is_plain


def test_a_taught_phrase_a_name_and_a_plural_that_a_model_may_know_are_not_changed(clip):
    knowing = replace(clip, words=frozenset(["cup", "on", "the", "table"]))
    assert reads(knowing, "cup on the table") == ["cup on the table"]
    assert reads(clip, "jack in the box", {"jack in the box"}) == ["jack in the box"]
    assert reads(replace(clip, words=None), "where are the cups?") == ["cups"]
    [asked] = read_questions(clip, "cup on the table between the couch and the bed")
    assert [one.read for one in asked.anchors] == ["table between couch and bed"]


@pytest.mark.parametrize(
    "text, why", [(" ", "blank"), (",", "blank"), ("cup " * 60, "tokens"), ("cup on \udcff", "UTF-8")]
)
def test_what_cannot_be_asked_says_why_and_the_rest_of_a_list_is_asked(clip, text, why):
    assert why in read_questions(clip, text)[0].refusal
    assert reads(clip, f"bed, {text}")[0] == "bed"


@pytest.mark.parametrize(
    "word, meant", [("red coutch", "red couch"), ("televison", "television"), ("zeppelin", None)]
)
def test_a_word_that_was_never_taught_has_a_near_one_or_none(clip, word, meant):
    assert suggest(clip, word, word.split()[-1:]) == (meant and f'Did you mean "{meant}"?')
