"""Masks of classes, and instances that overlap."""

from dataclasses import replace

import numpy as np
import pytest

from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import Query, categories, mask_of
from egosplat.evaluation.scores import (
    AnsweredQuery,
    bounding_boxes,
    count_right,
    mask_classes,
    pixel_accuracy,
    score_query,
)
from egosplat.frames.recording import Instance
from egosplat.query.answers import ViewMatch
from egosplat_rivals.formats.labeled_annotations import paint_layers

SIZE = (12, 16)
INSTANCES = [
    Instance(index + 1, name, name, "static", "object") for index, name in enumerate(("box", "sign", "wall"))
]
EVERY = ScoringOptions(min_area=0.0, excluded=())


@pytest.fixture
def masks() -> np.ndarray:
    """(3, 12, 16) bool: a box, its sign, and a wall that the box covers in part; a border of two columns without any."""
    found = np.zeros((3, *SIZE), bool)
    found[0, 3:9, 4:10], found[1, 4:6, 5:7], found[2, :5, :14] = True, True, True
    return found


def layers_and_queries(masks) -> tuple[np.ndarray, list[Query]]:
    layers = paint_layers(enumerate(masks), SIZE)
    return layers, [Query(0, 0, *named) for named in categories(layers, INSTANCES, EVERY)]


def test_the_most_relevant_class_wins_and_the_first_of_equal_ones():
    one, two = np.zeros(SIZE, np.float32), np.zeros(SIZE, np.float32)
    one[:6], two[:, :8], two[0, 0] = 0.5, 0.5, 0.6
    maps = ("1", one), ("2", two)
    shown = [ViewMatch(name, 1.0, "whole", None, None, x, None, x > 9) for name, x in maps]
    second, first = (answer.mask for answer in mask_classes(lambda *_: shown, ())(0, ["2", "1"]))
    assert (first == ((one > 0) & (one >= two))).all() and second[0, 0]
    assert second.sum() == 6 * 8 + 1
    # Nothing is visible in the last columns of the lower half.
    assert not (first | second)[6:, 8:].any()


def test_the_share_of_right_pixels_is_that_of_equal_rows_of_labels(masks):
    """As 3D-OVS counts: a pixel is right if the row of its labels is that of its class alone."""
    layers, queries = layers_and_queries(masks)
    winner = np.random.default_rng(0).integers(0, 3, SIZE)
    right = [count_right(one, winner == one.instances["all"][0], layers, INSTANCES) for one in queries]
    predicted = np.stack([winner == index for index in range(3)])
    expected = (predicted == masks).all(axis=0).mean()
    answered = [AnsweredQuery(*given, {}) for given in zip(queries, [{}] * 3, right, strict=True)]
    assert pixel_accuracy(answered, winner.size) == pytest.approx(expected) and 0 < expected < 1
    # The mean over two frames, of which one has nothing right.
    answered.append(AnsweredQuery(replace(queries[0], frame=1), {}, 0, {}))
    assert pixel_accuracy(answered, winner.size) == pytest.approx(expected / 2)
    assert pixel_accuracy([], 9) is None


def test_what_others_cover_is_scored_whole(masks):
    layers, queries = layers_and_queries(masks)
    assert len(layers) > 1
    for query in queries:
        (index,) = query.instances["all"]
        mask = masks[index]
        rows, columns = np.nonzero(mask)
        [box] = bounding_boxes(layers, [index]).tolist()
        assert box == [columns.min(), rows.min(), columns.max(), rows.max()]
        assert (mask_of(layers, [index]) == mask).all()
        score = score_query(query, (columns[0], rows[0]), mask, layers, np.ones(SIZE, bool))["all"]
        assert score.hit and score.iou == 1.0
        # The first layer alone has the sign, and parts of the box and the wall.
        assert (mask_of(layers[0], [index]) == mask).all() == (index == 1)
