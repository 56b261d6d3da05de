"""The probability that an answer is right: how it is fitted, and how the limits of its grades are chosen."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from benchmarks.presence import __main__ as page
from benchmarks.presence.fit import (
    Limits,
    brier,
    choose_limits,
    fit_logistic,
    held_out,
    judged,
    predict,
    reliability,
)
from benchmarks.rows import EVIDENCE
from egosplat.errors import UserError
from egosplat.query import grades as calibration
from egosplat.query.grades import Evidence, grading_of, read_fits
from egosplat.query.options import QueryOptions
from tests.support.rows import SCENES, some_rows


def asked(p: list[float], present: list[int], right: list[int]) -> tuple[pd.Series, pd.DataFrame]:
    rows = pd.DataFrame({"present": present, "true": np.multiply(present, right)})
    return pd.Series(p), rows


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
    """Words that nobody taught, answers that no frame verifies, and queries without any thing; absent things are wrong."""
    rows = pd.DataFrame(
        [
            (1, 0, 1.0, 0.0),
            (1, 1, 1.0, 0.0),
            (1, 0, None, 0.0),
            (0, 0, None, 0.0),
            (0, 0, None, None),
            (0, 1, None, 0.0),
        ],
        columns=["present", "untaught", "right", "lead"],
    )
    assert judged(rows)["true"].tolist() == [1.0, 0.0]


def test_the_limits_keep_absent_things_out_and_guesses_useful():
    """One of 40 absent things may be found; of the guesses for present things a third is right from 0.21, half from 0.31."""
    absent = [0.91] + [0.2] * 38 + [0.64]
    p, rows = asked([0.9, 0.6, 0.45, 0.3, 0.3, *absent], [1] * 5 + [0] * 40, [1, 1, 0, 0, 0] + [0] * 40)
    assert choose_limits(p, rows) == Limits(found=0.65, guess=0.31)
    p, rows = asked([0.9, 0.9, 0.9, 0.3, 0.3, *absent], [1] * 5 + [0] * 40, [1, 1, 0, 0, 0] + [0] * 40)
    assert choose_limits(p, rows) == Limits(found=0.65, guess=0.65)
    p, rows = asked([0.9, 0.4, *[0.1] * 40], [1] * 2 + [0] * 40, [1, 1] + [0] * 40)
    assert choose_limits(p, rows) == Limits(found=0.5, guess=0.25)


def test_curve_and_score_of_probabilities():
    p, true = pd.Series([0.1, 0.1, 0.9, 1.0]), pd.Series([0.0, 1.0, 1.0, 1.0])
    assert [row[2:] for row in reliability(p, true, bins=2)] == [(0.1, 0.5, 2), (0.95, 1.0, 2)]
    assert brier(p, true) == pytest.approx((0.01 + 0.81 + 0.01) / 4)


def test_a_fit_is_read_as_it_was_written(tmp_path, monkeypatch):
    """The fit of another OpenCLIP stays, and validation apartments take no part."""
    for module in (page, calibration):
        monkeypatch.setattr(module, "FITS", tmp_path / "fits.csv")
    (tmp_path / "fits.csv").write_text("clip\n")
    rows = page.asked_of(some_rows())
    options = QueryOptions()

    monkeypatch.setattr(page, "recorded_options", lambda _: options)
    try:
        for clip in ("other", "cafe"):
            read_fits.cache_clear()
            document = {"models": {"clip_checkpoint": {"hash": clip}}, "provenance": {"options": {}}}
            page.write_fit([SimpleNamespace(document=document)] * 2, rows, Limits(0.6, 0.3))
        read_fits.cache_clear()
        assert set(read_fits()) == {"other", "cafe"}
        found = grading_of("cafe", options).calibration
    finally:
        read_fits.cache_clear()
    expected = fit_logistic(rows[[*EVIDENCE]].to_numpy(float), rows["true"].to_numpy())
    values = rows[[*EVIDENCE]].iloc[0].astype(float)
    assert found.probability(Evidence(**values)) == pytest.approx(
        predict(expected, values.to_numpy()[None])[0], abs=1e-3
    )
    assert (found.found, found.guess) == (0.6, 0.3)


def test_validation_apartments_take_no_part():
    rows = some_rows()
    table = rows.tables["presence"]
    table["scene"] = table["scene"].replace({SCENES[0]: "adt/scene6", SCENES[1]: "adt/scene1"})
    with pytest.raises(UserError, match="two scenes"):
        page.asked_of(rows)
