"""Scores of queries and of a scene."""

from dataclasses import replace

import numpy as np
import pytest

from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import Query, categories
from egosplat.evaluation.scores import iou, score_query, summarise


@pytest.fixture
def queries(instance_map, instances) -> list[Query]:
    """Book (static and dynamic), dining chair, person."""
    asked = ScoringOptions(min_area=0.0, excluded=("shelter",))
    things = [replace(instance, instance_type="object") for instance in instances]
    return [Query(0, 10, name, groups) for name, groups in categories(instance_map[None], things, asked)]


def answer(instance_map: np.ndarray, query: Query) -> tuple[tuple[int, int], np.ndarray]:
    """A perfect one: a pixel of the first instance, and all pixels of the category."""
    mask = np.isin(instance_map, query.instances["all"])
    rows, columns = np.nonzero(instance_map == query.instances["all"][0])
    return (columns[0], rows[0]), mask


def summary(queries, answers, layers, valid=None):
    how = layers, np.ones(layers.shape[1:], bool) if valid is None else valid
    scores = [score_query(query, *given, *how) for query, given in zip(queries, answers, strict=True)]
    return summarise([query.category for query in queries], scores)


def test_perfect_answers_have_perfect_scores(instance_map, queries):
    answers = [answer(instance_map, query) for query in queries]
    found = summary(queries, answers, instance_map[None])
    assert [found[name]["count"] for name in ("static", "dynamic", "all")] == [2, 2, 3]
    score = found["all"]
    assert (score["accuracy"], score["mean_iou"], score["categories"]) == (1.0, 1.0, 3)
    assert score["accuracy_interval"][0] < 0.6 and score["mean_iou_interval"][1] == 1.0
    # Of the books the static one is hit, and the mask of both is larger than that of either.
    assert found["static"]["accuracy"] == 1.0 and found["dynamic"]["accuracy"] == 0.5
    assert found["static"]["mean_iou"] == pytest.approx((24 / 84 + 1) / 2)
    assert found["dynamic"]["mean_iou"] == pytest.approx((60 / 84 + 1) / 2)


@pytest.fixture
def ring() -> np.ndarray:
    """(1, 20, 20) int32: instance 0 is a ring whose middle is instance 1; 2 is one pixel."""
    labels = np.full((1, 20, 20), -1, np.int32)
    labels[0, 4:13, 6:15] = 0
    labels[0, 7:10, 9:12] = 1
    labels[0, 19, 0] = 2
    return labels


def scored(ring, members, pixel=None, valid=None):
    valid = np.ones((20, 20), bool) if valid is None else valid
    query = Query(0, 0, "thing", {"all": members})
    return score_query(query, pixel, ring[0] == members[0], ring, valid)["all"]


@pytest.mark.parametrize(
    "members, pixel, box",
    [
        ((0,), (6, 4), True),
        ((0,), (14, 12), True),
        ((0,), (15, 12), False),
        ((0,), (5, 4), False),
        ((0,), (10, 8), True),
        ((0, 2), (0, 19), True),
        ((0, 1), (0, 19), False),
        ((0, 1, 2), None, False),
        # Between two instances is in the box of neither.
        ((0, 2), (3, 16), False),
    ],
)
def test_a_pixel_hits_the_box_of_any_instance(ring, members, pixel, box):
    assert scored(ring, members, pixel).hit is box


def test_chance_is_the_share_of_valid_pixels_that_hit_and_the_middle_of_the_picture(ring):
    assert scored(ring, (0, 1)).random_hit == 81 / 400
    left = np.arange(400).reshape(20, 20) % 20 < 8
    assert scored(ring, (0, 1), valid=left).random_hit == 9 * 2 / (20 * 8)
    assert [scored(ring, (member,)).middle_hit for member in (0, 1, 2)] == [True, False, False]


def square(x0: int, y0: int, size: int) -> np.ndarray:
    mask = np.zeros((20, 20), bool)
    mask[y0 : y0 + size, x0 : x0 + size] = True
    return mask


@pytest.mark.parametrize(
    "predicted, valid, expected",
    [
        ((2, 2, 4), 20, 1.0),
        ((10, 10, 4), 20, 0.0),
        ((4, 2, 4), 20, 8 / 24),
        ((2, 2, 0), 20, 0.0),
        ((0, 0, 20), 7, 16 / 49),
        ((0, 0, 20), 6, 16 / 36),
    ],
)
def test_iou_agrees_with_a_hand_computed_value(predicted, valid, expected):
    assert iou(square(*predicted), square(2, 2, 4), square(0, 0, valid)) == pytest.approx(expected)
