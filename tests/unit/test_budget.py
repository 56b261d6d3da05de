"""A budget chooses from the measured front, above the preset and below the user's keys."""

import json

import pytest

from egosplat.config import resolve
from egosplat.errors import UserError

MEASURED = {"scene": "adt/scene1", "origin": "synthetic", "about": "apartments", "machines": [], "seeds": 3}


def entry(label, minutes, accuracy, **keys):
    return {"label": label, "minutes": minutes, "accuracy": accuracy, "keys": keys}


@pytest.fixture
def presets(tmp_path):
    """A folder of presets, with a front beside it."""
    folder = tmp_path / "presets"
    folder.mkdir()
    (folder / "balanced.yaml").write_text("splats: {iterations: 77, sh_degree: 1}")
    points = [
        entry("rough", 3.0, 0.3, splats={"iterations": 10}),
        entry("middle", 9.5, 0.4, splats={"iterations": 20}, features={"dims": 4}),
        entry("fine", 40.0, 0.5, splats={"iterations": 30}),
    ]
    content = {"format_version": 1, "measured": MEASURED | {"confidence": 0.95}, "points": points}
    (tmp_path / "front.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    "budget, iterations",
    [
        ({}, 77),
        ({"minutes": None}, 77),
        ({"minutes": 3}, 10),
        ({"minutes": 10}, 20),
        ({"minutes": 1000}, 30),
        ({"accuracy": 0.0}, 10),
        ({"accuracy": 0.31}, 20),
        ({"accuracy": 0.5}, 30),
    ],
)
def test_the_best_point_that_fits_is_taken(presets, budget, iterations):
    assert resolve({"budget": budget}, presets)["splats"]["iterations"] == iterations


def test_its_keys_stand_between_the_preset_and_the_users(presets):
    found = resolve({"budget": {"minutes": 10}, "features": {"dims": 5}}, presets)
    assert (found["splats"]["iterations"], found["splats"]["sh_degree"]) == (20, 1)
    assert found["features"]["dims"] == 5


@pytest.mark.parametrize(
    "budget, message",
    [
        (
            {"minutes": 2},
            r"budget.minutes = 2: no point of .*front.json is as fast.\nThe nearest is rough: 3 minutes",
        ),
        (
            {"accuracy": 0.9},
            r"budget.accuracy = 0.9: .* is as accurate.\nThe nearest is fine: 40 minutes, accuracy 0.5",
        ),
        ({"minutes": 2, "accuracy": 0.1}, "minutes and accuracy are both set"),
        ({"minutes": 0}, "budget.minutes = 0 is not allowed: more than 0"),
        ({"accuracy": 40}, "budget.accuracy = 40 is not allowed: at most 1"),
        ({"hours": 1}, "unknown key 'budget.hours'"),
    ],
)
def test_what_cannot_be_met_is_told(presets, budget, message):
    with pytest.raises(UserError, match=message):
        resolve({"budget": budget}, presets)


def test_without_a_measured_front_there_is_no_budget(presets):
    (presets.parent / "front.json").unlink()
    with pytest.raises(
        UserError, match=r"front.json does not exist: .* measured first.*\nRun: snakemake .* egosplat front"
    ):
        resolve({"budget": {"minutes": 3}}, presets)
    assert resolve({}, presets)["splats"]["iterations"] == 77


@pytest.mark.parametrize(
    "content, message",
    [
        ("{", "front.json: cannot be read as JSON"),
        ("[]", "front.json: value = .* is not allowed: must be keys with values"),
        (None, "front.json, rough: unknown key 'splats.iteration'; did you mean 'iterations'"),
    ],
)
def test_a_front_that_is_none_is_named(presets, content, message):
    path = presets.parent / "front.json"
    path.write_text(content or path.read_text().replace('"iterations": 10', '"iteration": 10'))
    with pytest.raises(UserError, match=message):
        resolve({"budget": {"minutes": 3}}, presets)
