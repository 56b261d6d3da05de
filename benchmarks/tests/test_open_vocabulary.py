"""Tests of the measure of phrases that were not taught."""

import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_vocabulary import __main__ as open_vocabulary
from benchmarks.open_vocabulary import answering, colors
from benchmarks.open_vocabulary.answering import Answered, answer_scene
from benchmarks.open_vocabulary.colors import color_shares, is_doubtful, main_color
from benchmarks.open_vocabulary.phrases import NAME, NEW, UNTAUGHT, synonym_phrases
from benchmarks.open_vocabulary.questions import COLORED, TOLD_APART, WORDS, Question, find_questions
from egosplat.errors import UserError
from egosplat.evaluation.queries import Query
from egosplat.evaluation.scores import Result
from egosplat.frames.recording import Instance
from egosplat.pipeline import config as configuration
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from egosplat_apartments.world.world import make_world
from training.small_models.attributes import COLORS
from training.small_models.clip_vocabulary import known_words
from training.small_models.concepts import WHOLES


def shares_of(**colors: float) -> np.ndarray:
    """Shares by name, the rest none."""
    return np.array([colors.get(color, 0.0) for color in COLORS])


RED, BLUE, REDDISH = shares_of(red=1.0), shares_of(blue=0.9, red=0.1), shares_of(white=0.7, red=0.3)


def test_new_synonyms_are_in_no_caption_and_no_glossary():
    """Not one of their words, and each is of a category that is asked."""
    taught = set(known_words())
    words = {
        word for phrases in UNTAUGHT.values() for phrase in phrases for word in re.findall("[a-z]+", phrase)
    }
    assert not words & taught
    assert set(UNTAUGHT) <= set(CATEGORY_UIDS) & set(WHOLES)
    assert len(words) > 30


def test_the_color_of_a_thing_is_that_of_captions():
    assert main_color(RED) == "red" and main_color(REDDISH) == "white"
    assert main_color(shares_of(red=0.39, blue=0.3, white=0.31)) is None
    assert main_color(np.full(len(COLORS), np.nan)) is None
    assert is_doubtful(REDDISH, "red") and is_doubtful(np.full(len(COLORS), np.nan), "red")
    assert not is_doubtful(RED, "red") and not is_doubtful(BLUE, "red")


@pytest.fixture
def stripes() -> np.ndarray:
    """(10, 40) int32: four things beside each other."""
    return np.repeat(np.arange(4, dtype=np.int32), 10)[None].repeat(10, axis=0)


def asked(stripes: np.ndarray, shares: list[np.ndarray], min_area: float = 0.0) -> list[Question]:
    query = Query(0, 5, "couch", {"all": (0, 1), "static": (0,)})
    return find_questions([query], {5: stripes}, np.stack(shares), min_area)


def test_a_color_means_the_things_that_have_it(stripes):
    found = asked(stripes, [RED, BLUE, RED, RED])
    colored = {one.query.category: one for one in found if one.targets == TOLD_APART}
    red = colored["red couch"]
    assert red.query.instances == {"all": (0,)} and (red.color, red.category) == ("red", "couch")
    assert colored["blue couch"].query.instances == {"all": (1,)}
    # Both are asked by the name alone as well, for the same things.
    names = [one.query.instances["all"] for one in found if (one.targets, one.kind) == (COLORED, NAME)]
    assert names == [(1,), (0,)]
    words = [one for one in found if one.targets == WORDS]
    assert {one.query.category for one in words} == {
        phrase for phrases in synonym_phrases("couch").values() for phrase in phrases
    }
    assert all(one.query.instances["all"] == (0, 1) for one in words)


def test_a_color_that_another_thing_has_in_part_is_not_asked(stripes):
    found = asked(stripes, [RED, REDDISH, RED, RED])
    assert {one.color for one in found if one.targets != WORDS} == {"white"}


def test_colors_of_an_apartment_are_those_of_its_surfaces(monkeypatch):
    """Shares of what is seen, and what is seen of nothing has none; keys that make other things are named."""
    film = {"seed": 5, "seconds": 4.0, "objects": 16, "motion": 0.0, "world": "usual"}
    made = make_world(**film)
    monkeypatch.setattr(colors, "make_world", lambda **keys: made if film == keys else None)
    instances = [
        Instance(one.instance_id, one.name, one.category, one.motion_type, one.instance_type)
        for one in made.instances
    ]
    found = color_shares(film, instances)
    seen = ~np.isnan(found).any(axis=1)
    assert seen.sum() > 8 and found[seen].sum(axis=1) == pytest.approx(1.0, abs=1e-5)
    assert sum(main_color(one) is not None for one in found) > 8
    with pytest.raises(UserError, match="synthetic.seed = 5 makes no Sofa_99"):
        color_shares(film, [*instances, replace(instances[0], name="Sofa_99")])


def test_phrases_are_scored_as_the_benchmark_scores(word_scene, monkeypatch):
    """A wall of which the left half means a couch and the right half a cup: found by name, as metrics.json has it."""
    monkeypatch.setattr(answering, "color_shares", lambda film, instances: np.stack([RED, BLUE]))
    config = configuration.defaults()
    found = answer_scene(word_scene(), config)
    names = [one for one in found if (one.question.targets, one.question.kind) == (WORDS, NAME)]
    assert [(one.question.query.frame, one.question.category) for one in names] == [
        (1, "couch"),
        (1, "cup"),
        (2, "couch"),
        (2, "cup"),
    ]
    assert all(one.result.hit and one.result.iou > 0.8 for one in names)
    assert {one.result.random_hit for one in found} == {0.5}
    assert {one.question.query.category for one in found} >= {"red couch", "blue cup", "settee", "goblet"}


def answered(frame: int, category: str, kind: str, hit: bool) -> Answered:
    query = Query(0, frame, f"{kind} {category}", {"all": (1,)})
    return Answered(Question(WORDS, kind, category, None, query), Result(hit, 0.5, 0.05, False))


def test_rows_are_compared_with_the_name_for_the_same_targets():
    things = [f"thing {n}" for n in range(8)]
    scene = [answered(n, name, NAME, True) for n, name in enumerate(things)]
    scene += [answered(n, name, NEW, False) for n, name in enumerate(things[:6])]
    lines = list(open_vocabulary.rows([scene]))
    assert len(lines) == 2
    assert lines[0][:8] == [WORDS, NAME, "8", "8", "8", "100.0 (67.6 to 100.0)", "5.0", "0.0"]
    assert lines[1][2:8] == ["6", "6", "6", "0.0 (0.0 to 39.0)", "5.0", "0.0"]
    assert lines[1][-1] == "-100.0 (-100.0 to -21.9), p = 0.031"
