"""Captions are true of their crops, and false of crops that they do not describe."""

import numpy as np
import pytest

from egosplat_apartments.objects.catalogue import COFFEE_TABLE, CORE, GROUPS, REST
from training.small_models.attributes import COLORS
from training.small_models.captions import (
    describe,
    facts,
    held_out,
    main_color,
    make_claims,
    unseen_combination,
)
from training.small_models.concepts import KINDS, PARTS, WHOLES, Concept
from training.small_models.crops import Crops
from training.small_models.glossary import GLOSSARY

RED, BLUE = COLORS.index("red"), COLORS.index("blue")


def make_crops(rows: list[tuple[str, int, dict[int, float], str, float]]) -> Crops:
    """Crops of (name, number of the whole, shares of colors, surfaces, share of the whole)."""
    count = len(rows)
    colors = np.zeros((count, len(COLORS)), dtype=np.float32)
    for row, (_, _, shares, _, _) in enumerate(rows):
        for color, share in shares.items():
            colors[row, color] = share
    zeros = np.zeros(count, dtype=np.int32)
    return Crops(
        np.zeros((count, 1, 1, 4), dtype=np.uint8),
        zeros,
        np.array([row[0] for row in rows]),
        np.array([1 if "/" in row[0] else 2 for row in rows], dtype=np.int32),
        colors,
        np.array([row[3] for row in rows]),
        zeros + 100,
        zeros + 10,
        np.array([row[4] for row in rows], dtype=np.float32),
        zeros,
        np.array([row[1] for row in rows], dtype=np.int32),
        zeros,
    )


@pytest.fixture
def crops() -> Crops:
    """A few objects and parts."""
    return make_crops(
        [
            ("cup", 0, {RED: 0.8, BLUE: 0.2}, "striped pottery:0.90", 1.0),
            ("cup/handle", 0, {RED: 1.0}, "striped pottery:1.00", 0.1),
            ("couch", 1, {BLUE: 0.5, RED: 0.5}, "flowered cloth:0.60,wood:0.30", 1.0),
            ("couch/base", 1, {BLUE: 1.0}, "flowered cloth:1.00", 0.9),
            ("tea kettle/handle", 2, {BLUE: 1.0}, "plastic:1.00", 0.2),
        ]
    )


def truth_of(crops: Crops, phrase: str) -> list[int]:
    """Truth of the statement of a phrase, for every crop."""
    claims = make_claims(sorted(set(crops.names.tolist())))
    column = next(number for number, words in enumerate(claims.phrases) if phrase in words)
    return facts(claims, crops)[:, column].tolist()


@pytest.mark.parametrize(
    ("phrase", "truth"),
    [
        ("mug", [1, -1, 0, 0, 0]),
        ("sofa", [0, 0, 1, 1, 0]),
        ("furniture", [0, 0, 1, 1, 0]),
        ("handle", [-1, 1, 0, 0, 1]),
        ("mug handle", [-1, 1, 0, 0, 0]),
        ("red", [1, 1, -1, 0, 0]),
        ("striped", [1, 1, 0, 0, 0]),
        ("wooden", [0, 0, -1, 0, 0]),
    ],
)
def test_statements_are_true_false_or_undecided_of_a_crop(
    crops: Crops, phrase: str, truth: list[int]
) -> None:
    got = truth_of(crops, phrase)
    if phrase == "red":
        # Two colors with equal fractions: neither dominates, so both may be in a caption, and blue is not false.
        truth[2] = got[2]
        assert got[2] in (1, -1)
    assert got == truth


def test_descriptions_are_true_of_their_crops(crops: Crops) -> None:
    claims = make_claims(sorted(set(crops.names.tolist())))
    known = np.repeat(facts(claims, crops), 40, axis=0)
    told = describe(claims, known, np.random.default_rng(0))
    truth = told.truth(known)
    assert (np.diagonal(truth) == 1).all()
    # They also discriminate: most are false of other crops.
    assert (truth == 0).mean() > 0.3


def test_a_caption_with_a_false_word_is_false(crops: Crops) -> None:
    claims = make_claims(sorted(set(crops.names.tolist())))
    known = facts(claims, crops)
    told = describe(claims, known[:1], np.random.default_rng(0))
    blue = next(number for number, words in enumerate(claims.phrases) if words == ("blue",))
    told.columns[0] = [told.columns[0][0], blue, -1, -1]
    assert told.truth(known)[0, 0] == -1
    assert told.truth(known)[1, 0] == 0


def test_every_kind_of_the_catalogue_has_words() -> None:
    kinds = {*CORE, *REST, COFFEE_TABLE, *(one for group in GROUPS for one in group)}
    assert {kind.category for kind in kinds} <= set(WHOLES)
    assert all(set(listed.split(",")) <= set(WHOLES) for listed in KINDS.values())


def test_glossary_words_are_in_no_caption() -> None:
    said = {phrase for table in (WHOLES.values(), KINDS, PARTS) for phrases in table for phrase in phrases}
    assert set(GLOSSARY) <= set(WHOLES)
    assert not said & {word for words in GLOSSARY.values() for word in words}


def test_one_combination_in_eight_is_held_out(crops: Crops) -> None:
    pairs = [(color, name) for color in COLORS for name in WHOLES]
    share = np.mean([held_out(*pair) for pair in pairs])
    assert 0.09 < share < 0.16
    color, name = next(pair for pair in pairs if held_out(*pair) and pair[1] != "own arms")
    shown = COLORS.index(color)
    unseen = make_crops([(name, 5, {shown: 1.0}, "", 1.0), (f"{name}/x", 5, {RED: 1.0}, "", 0.3)])
    assert unseen_combination(unseen).tolist() == [True, True]
    assert main_color(unseen).tolist() == [shown, RED]


def test_a_part_that_is_nearly_the_whole_counts_as_the_whole() -> None:
    concept = Concept(("couch",), frozenset({"couch"}))
    assert concept.truth("couch/back", frozenset({"back"}), share=0.9) == 1
    assert concept.truth("couch/back", frozenset({"back"}), share=0.5) == -1
    assert concept.truth("desk", frozenset(), share=1.0) == 0
