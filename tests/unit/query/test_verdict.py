"""The numbers of a query: when it is refused, how that is said, and its options."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.language.decoder import Decoder
from egosplat.language.vectors import unit
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.query import contest, grades
from egosplat.query.calibrate import read_labels
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import FOUND, GUESS, NOT_FOUND, Calibration, Evidence, by_probability, by_score
from egosplat.query.options import AskingOptions, QueryOptions
from egosplat.query.text import Texts, other_meanings
from tests.support.langsplat import LANGSPLAT

FIT = Calibration(-1.0, {"level": 0.25, "fit": 1.0, "apart": 2.0, "lead": 3.0}, 0.7)


def test_the_probability_is_the_logistic_of_the_evidence():
    expected = 1 / (1 + math.exp(-(-1.0 + 0.25 * 0.5 + 3.0 + 2.0 * 0.5 - 3.0 * 0.25)))
    assert FIT.probability(Evidence(0.5, 3.0, 0.5, -0.25)) == pytest.approx(expected)
    assert [FIT.probability(Evidence(0.0, fit, 0.0, 0.0)) for fit in (1e6, -1e6)] == [1.0, 0.0]


OTHERS = {"temperature": 5.0, "min_score": 0.5, "box_filter": 0.0, "segmentation_threshold": 0.5}
OTHERS |= {"canonical": ("thing",), "size_weight": 0.0}


def test_a_fit_holds_for_its_openclip_and_its_keys_alone_and_the_bundled_ones_have_fits(monkeypatch):
    for name in ("small", "photos"):
        bundled = model_hash(CLIP, {"clip_model": name, "clip_checkpoint": name})
        assert grades.grading_of(bundled, AskingOptions().suit(name)).calibration is not None
    weights = {"level": 2.0, "fit": 3.0, "apart": 4.0, "lead": 5.0}
    row = grades.held_keys(QueryOptions()) | {name: str(weight) for name, weight in weights.items()}
    row |= {"intercept": "-1", "present_share": "0.4", "misplaced": "0.2"}
    monkeypatch.setattr(grades, "read_fits", lambda: {"cafe": row})
    own = Calibration(-1.0, weights, 0.4)
    assert grades.grading_of("cafe", QueryOptions(present_share=0.4)).calibration == own
    # Who asks of nothing that is absent meets the fifth of the errors that is on what is there.
    [sure] = [grades.grading_of("cafe", QueryOptions(present_share=1.0)).calibration]
    assert sure.intercept == pytest.approx(-1.0 + math.log(5))
    assert grades.grading_of("beef", QueryOptions()) == grades.AMONG_WORDS
    for key, value in OTHERS.items():
        options = QueryOptions(**{key: value})
        assert grades.grading_of("cafe", options) == by_score(options.min_score), key


def test_hypernyms_kinds_parts_and_synonyms_are_no_rivals():
    words = ("bed", "couch", "cushion", "desk", "table")
    rivals = {"side table": "bed couch cushion desk", "table": "bed couch cushion", "couch": "bed desk table"}
    queries = torch.eye(6)
    queries[3, 3:5] = torch.tensor([0.6, 0.8])  # a desk is called a table
    for phrase, others in (rivals | {"stable": " ".join(words)}).items():
        own = queries[words.index(phrase)] if phrase in words else torch.eye(6)[5]
        found = other_meanings(Texts((phrase,), own[None], own[None]), Texts(words, queries[:5], own[None]))
        assert [word for word, other in zip(words, found, strict=True) if other] == others.split(), phrase


def test_a_judgement_that_is_none_is_named_by_its_line(tmp_path):
    for line in ("  ,absent", "cup,wrong", "cup", "cup,maybe"):
        (labels := tmp_path / "labels.csv").write_text(f"phrase,label\ncup,right\n{line}\n")
        with pytest.raises(UserError, match=r"labels.csv: line 3"):
            read_labels(labels)


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
        *((score, least, None) for least in (0.775, 0.785) for score in (0.77499, 0.7849, 0.785, 0.7851)),
        *((p, None, None) for p in (2 / 3, 0.6666, 0.25, 0.2499, 1.0, 0.0)),
    ],
)
def test_a_number_is_shown_on_the_side_of_the_limits_of_its_grade(score, least, expected):
    grading = by_probability(FIT) if least is None else by_score(least)
    shown, grade = grading.shown(score), grading.grade(score)
    assert expected in (None, shown) and grading.grade(float(shown)) == grade
    assert (grading.refusal(score) is None) is (grade != NOT_FOUND)
    assert (least is None) == ("70%" in grading.notice)
    found, guess = (2 / 3, 0.25) if least is None else (least, least)
    assert grade == (FOUND if score >= found else GUESS if score >= guess else NOT_FOUND)


def test_random_weights_find_none_of_fifty_words_and_what_is_like_its_word_is_found(word_scene, monkeypatch):
    rng, known = np.random.default_rng(0), dict[str, np.ndarray]()

    def encode(_, phrases, short=False):
        for phrase in phrases:
            known.setdefault(phrase, unit(rng.normal(size=512)))
        return torch.from_numpy(np.array([known[one] for one in phrases])).float()

    monkeypatch.setattr(contest, "encode_phrases", encode)
    monkeypatch.setattr(contest, "untaught_words", lambda *_: [])
    clip = SimpleNamespace(model=SimpleNamespace(logit_scale=torch.tensor(100.0).log()))
    scene, things = open_scene(word_scene()).trained, unit(rng.normal(size=(24, 512)))
    things[0] = unit(things[0] + encode(clip, ["zebra"])[0].numpy())
    code = torch.from_numpy(things[np.arange(len(scene.code)) % 24]).float()[:, None].repeat(1, 2, 1)
    decoder = Decoder((512,), np.zeros(0, np.float32))
    coded = replace(scene, code=code, share=torch.ones_like(scene.share), decoder=decoder)
    found, canonical = contest.Contest(coded, clip, QueryOptions()), encode(clip, QueryOptions().canonical)
    words = ["zebra", *(f"word {number}" for number in range(50))]
    best = [found.best(Texts((word,), encode(clip, [word]), canonical)) for word in words]
    assert best[0] > grades.AMONG_WORDS.found > max(best[1:])
