"""The probability that an answer is right: how it is fitted, and how it moves to other shares of present things."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.presence import __main__ as page
from benchmarks.presence.fit import at_share, brier, held_out, judged, predict, reliability
from benchmarks.rows import EVIDENCE
from egosplat.cli.scenes import calibrate
from egosplat.errors import UserError
from egosplat.query import grades as calibration
from egosplat.query.calibrate import fit_logistic, run
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import Evidence, grading_of, read_fits
from egosplat.query.options import QueryOptions
from egosplat.query.text import words_to_try
from tests.support.rows import SCENES, some_rows


def test_the_weights_are_those_that_made_the_answers():
    rng = np.random.default_rng(0)
    x, true = rng.normal(size=(4000, 2)), np.array([0.5, 2.0, -1.0])
    y = (rng.random(4000) < predict(true, x)).astype(float)
    np.testing.assert_allclose(fit_logistic(x, y), true, atol=0.15)


def test_weights_stay_finite_where_all_answers_are_right():
    assert np.isfinite(fit_logistic(np.array([[0.0], [1.0]]), np.ones(2))).all()


def test_a_scene_has_no_part_in_its_own_prediction():
    rows = judged(some_rows().of("presence", "full"))
    changed = rows.assign(true=np.where(rows["scene"] == SCENES[0], 1 - rows["true"], rows["true"]))
    mine, other = held_out(rows), held_out(changed)
    of_first = rows["scene"] == SCENES[0]
    np.testing.assert_array_equal(mine[of_first], other[of_first])
    assert (mine[~of_first] != other[~of_first]).all()


def test_what_tells_nothing_of_an_answer_is_left_out():
    """Words that nobody taught, answers that no frame verifies, queries without any thing, and parts of what is there; absent things
    are wrong."""
    rows = pd.DataFrame(
        [
            ("a", "couch", 1, 0, 1.0, 0.0),
            ("a", "cup", 1, 1, 1.0, 0.0),
            ("a", "bed", 1, 0, None, 0.0),
            ("a", "vase", 0, 0, None, 0.0),
            ("a", "desk", 0, 0, None, None),
            ("a", "pot", 0, 1, None, 0.0),
            ("a", "pillow", 0, 0, None, 0.0),
            ("b", "pillow", 0, 0, None, 0.0),
        ],
        columns=["scene", "phrase", "present", "untaught", "right", "apart"],
    )
    assert judged(rows.assign(score=0.5))[["phrase", "true"]].values.tolist() == [
        ["couch", 1.0],
        ["vase", 0.0],
        ["pillow", 0.0],
    ]


def test_probabilities_hold_at_another_share_of_present_things():
    """Answers of one score: of 40 on present things 30 are right, of 60 on absent ones none."""
    rows = pd.DataFrame({"present": [1] * 40 + [0] * 60, "true": [1] * 30 + [0] * 70})
    p = pd.Series(np.full(100, 0.3))
    for share in (0.4, 0.7, 0.95, 1.0):
        shifted, weight = at_share(p, rows, share)
        np.testing.assert_allclose(shifted, np.average(rows["true"], weights=weight))
        assert np.average(rows["present"], weights=weight) == pytest.approx(share)


def test_curve_and_score_of_probabilities():
    p, true = pd.Series([0.1, 0.1, 0.9, 1.0]), pd.Series([0.0, 1.0, 1.0, 1.0])
    assert [row[2:] for row in reliability(p, true, bins=2)] == [(0.1, 0.5, 2), (0.95, 1.0, 2)]
    assert brier(p, true) == pytest.approx((0.01 + 0.81 + 0.01) / 4)


def test_a_fit_is_read_as_it_was_written(tmp_path, monkeypatch):
    """The fit of another OpenCLIP stays, and validation apartments take no part."""
    (tmp_path / "fits.csv").write_text("clip\n")
    for module in (page, calibration):
        monkeypatch.setattr(module, "FITS", tmp_path / "fits.csv")
    few = page.asked_of(some_rows())
    rows = pd.concat([few, few])
    own = float((rows["present"] == 1).mean())
    options = QueryOptions(present_share=own)
    monkeypatch.setattr(page, "recorded_options", lambda _: options)
    for clip in ("other", "cafe"):
        document = {"models": {"clip_checkpoint": {"hash": clip}}, "provenance": {"options": {}}}
        page.write_fits([SimpleNamespace(document=document)] * 2, rows)
    with pytest.raises(UserError, match=f"{SCENES[0]}.* 4 absent; give 20"):
        page.write_fits([SimpleNamespace(document=document)] * 2, few)
    assert set(read_fits()) == {"other", "cafe"} and calibration.is_contested("cafe", read_fits())
    found = grading_of("cafe", options).calibration
    expected = fit_logistic(rows[[*EVIDENCE]].to_numpy(float), rows["true"].to_numpy())
    values = rows[[*EVIDENCE]].iloc[0].astype(float)
    assert found.probability(Evidence(**values)) == pytest.approx(
        predict(expected, values.to_numpy()[None])[0], abs=1e-3
    )


def test_validation_apartments_take_no_part():
    rows = some_rows()
    table = rows.tables["presence"]
    table["scene"] = table["scene"].replace({SCENES[0]: "adt/scene6", SCENES[1]: "adt/scene1"})
    with pytest.raises(UserError, match="two scenes"):
        page.asked_of(rows)


def test_grades_of_a_scene_follow_judgements_of_its_user(word_scene):
    scene = open_scene(word_scene())
    own, labels, shipped = scene.folder / "grades.csv", scene.folder / "labels.csv", scene.grading()
    answers = sorted(scene.ask(*words_to_try(scene.clip)), key=lambda one: -one.candidates[0].score)
    kinds = ["right"] * 10 + ["wrong"] * 4 + ["absent"] * 12
    lines = [f"{one.phrase},{kind}" for one, kind in zip(answers, kinds, strict=False)]
    labels.write_text("\n".join(["phrase,label", *lines]))
    for _ in range(2):  # the second fit takes the place of the first one
        done = CliRunner().invoke(calibrate, [str(scene.folder), str(labels)], catch_exceptions=False)
        assert done.exit_code == 0 and "10 right, 4 wrong, 12 absent" in done.output
        assert len(read_fits(own)) == 1
    assert scene.grading().calibration not in (shipped.calibration, None)
    assert replace(scene, checked=True).grading() == shipped, "no stage knows of it"
    assert scene.ask(answers[0].phrase)[0].grade == "found"
    assert open_scene(scene.folder, min_score=0.6).grading().measure == "score", "it holds for its keys alone"
    own.write_text("clip,intercept\nx,y\n")
    with pytest.raises(UserError, match=f"{own}: is damaged; remove it"):
        scene.ask("cup")


@pytest.mark.parametrize(
    "text, told",
    [
        ("", "phrase,label"),
        ("word,label\ncup,right\n", "word,label"),
        ("phrase,label\ncup,good\n", "line 2"),
        ("phrase,label\n\ncup,right,1\n", "line 3"),
        ("phrase,label\ncup,right\ncup,absent\n", "line 3"),
        (
            'phrase,label\n"cup",right\n\ncouch,absent\nzeppelin,absent\n',
            "judges 2 .* 1 right, 0 wrong, 1 absent",
        ),
    ],
)
def test_judgements_that_fit_nothing_are_refused(word_scene, text, told):
    scene = open_scene(word_scene())
    (labels := scene.folder / "labels.csv").write_text(text)
    with pytest.raises(UserError, match=f"{labels}: .*{told}"):
        list(run(scene, labels))
    assert not (scene.folder / "grades.csv").exists()
