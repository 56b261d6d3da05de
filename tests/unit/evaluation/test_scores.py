"""The scores of a scene."""

import numpy as np
import pytest

from egosplat.evaluation.intervals import IntervalOptions
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import Query, categories
from egosplat.evaluation.scores import QueryScore, Result, score_query, summarise

OPTIONS = IntervalOptions(confidence=0.95, resamples=200, seed=0)


@pytest.fixture
def queries(instance_map, instances) -> list[Query]:
    """Book (static and dynamic), dining chair, person."""
    asked = ScoringOptions(min_area=0.0, excluded=("shelter",), people=True)
    return [Query(0, 10, name, groups) for name, groups in categories(instance_map, instances, asked)]


def answer(instance_map: np.ndarray, query: Query) -> tuple[tuple[int, int], np.ndarray]:
    """A perfect one: a pixel of the first instance, and all pixels of the category."""
    mask = np.isin(instance_map, query.instances["all"])
    rows, columns = np.nonzero(instance_map == query.instances["all"][0])
    return (columns[0], rows[0]), mask


@pytest.mark.parametrize("target", ["box", "mask"])
def test_perfect_answers_have_perfect_scores(instance_map, queries, target):
    scores = [score_query(one, *answer(instance_map, one), instance_map, None, target) for one in queries]
    found = summarise(scores, OPTIONS)
    assert [found[name].count for name in ("static", "dynamic", "all")] == [2, 2, 3]
    assert (found["all"].accuracy, found["all"].mean_iou) == (1.0, 1.0)
    assert found["all"].categories == 3
    assert found["all"].accuracy_interval.low < 0.6 and found["all"].mean_iou_interval.high == 1.0
    # Of the books the static one is hit, and the mask of both is larger than that of either.
    assert found["static"].accuracy == 1.0 and found["dynamic"].accuracy == 0.5
    assert found["static"].mean_iou == pytest.approx((24 / 84 + 1) / 2)
    assert found["dynamic"].mean_iou == pytest.approx((60 / 84 + 1) / 2)


def test_no_answers_score_zero(instance_map, queries):
    nothing = None, np.zeros(instance_map.shape, bool)
    found = summarise([score_query(one, *nothing, instance_map, None, "box") for one in queries], OPTIONS)
    assert (found["all"].accuracy, found["all"].mean_iou, found["all"].count) == (0.0, 0.0, 3)


def test_answers_to_other_questions_are_chance():
    """On ten equal stripes an answer to a random one of ten questions is right in a tenth of the cases."""
    stripes = np.repeat(np.arange(10, dtype=np.int32), 4)[None].repeat(8, axis=0)
    rng, scores = np.random.default_rng(0), []
    for frame in range(60):
        for own, other in enumerate(rng.permutation(10)):
            query = Query(frame, frame, str(own), {"static": (own,), "all": (own,)})
            given = (4 * other + 1, 5), stripes == other
            scores.append(score_query(query, *given, stripes, None, "box"))
    found = summarise(scores, OPTIONS)["all"]
    assert found.count == 600 and 0.06 < found.accuracy < 0.14 and found.mean_iou == found.accuracy
    assert found.accuracy_interval.low < 0.1 < found.accuracy_interval.high


def test_a_thing_that_is_found_in_ten_frames_is_found_once():
    """Two categories in ten frames each: twenty queries leave the doubt of two things, not of twenty."""
    found = Result(True, 0.5, 0.1, False)
    scores = [QueryScore(name, {"all": found}) for name in ("couch", "cup") for _ in range(10)]
    score = summarise(scores, OPTIONS)["all"]
    assert (score.count, score.categories) == (20, 2)
    assert score.accuracy_interval.low < 0.35
    assert summarise(scores[:10], OPTIONS)["all"].accuracy_interval is None


def test_chance_stands_beside_the_accuracy(instance_map, queries):
    """Whatever is answered: a random pixel, and the middle of the picture, of all frames together."""
    valid = np.ones(instance_map.shape, bool)
    valid[:, :4] = False
    scores = [score_query(one, *answer(instance_map, one), instance_map, valid, "box") for one in queries[:1]]
    scores += [score_query(queries[-1], *answer(instance_map, queries[0]), instance_map, valid, "box")]
    found = summarise(scores, OPTIONS)["all"]
    books, person = 84 / 1080, 50 / 1080
    assert found.random_pixel == pytest.approx((books + person) / 2)
    # The middle, (20, 15), is in the box of the moving book.
    assert found.middle_pixel == 0.5
