"""Each alarm is raised just beyond its limit, and has one line on every page and one row in docs/alarms.md."""

import math
import re

import pytest

from egosplat.alarms.artifact_alarms import (
    alarm_line,
    find_alarm,
    find_chance_alarm,
    found_text,
    warning_lines,
)
from egosplat.alarms.statistics import relative_agreement
from egosplat.alarms.table import TABLE, Alarm
from egosplat.pipeline.config import read_yaml, section_keys
from tests.support import ROOT

CONSTANT = [key for key, row in TABLE.items() if row.limit is not None]
SHOWN = [key for key in CONSTANT if "{value" in TABLE[key].sentence]
CAUSED = [key for key, row in TABLE.items() if row.causes]


def beyond(key: str, distance: float) -> float:
    below = TABLE[key].normal.startswith("up to")
    return TABLE[key].limit + (distance if below else -distance)


@pytest.mark.parametrize("key", CONSTANT)
def test_an_alarm_is_raised_just_beyond_its_limit_and_not_at_it(key):
    limit, value = TABLE[key].limit, beyond(key, 1e-6)
    assert find_alarm(key, {"value": limit}) == []
    (alarm,) = find_alarm(key, {"value": value, "more": 3})
    assert (alarm.key, alarm.figures) == (key, {"value": value, "limit": limit, "more": 3})


def test_infinite_psnr_raises_no_alarm_and_nan_does():
    assert find_alarm("splats.psnr", {"value": math.inf}) == []
    (alarm,) = find_alarm("splats.psnr", {"value": math.nan})
    assert "nan dB" in alarm_line(alarm) == alarm_line(Alarm("splats.psnr", {"value": None, "limit": 20.0}))


def test_an_accuracy_whose_interval_reaches_chance_raises_an_alarm():
    chance = {"random_pixel": 0.15, "middle_pixel": 0.1}
    for interval, keys in (((0.151, 1), []), (None, []), ((0.15, 1), ["metrics.chance"])):
        found = find_chance_alarm(chance | {"accuracy_interval": interval})
        assert [alarm.key for alarm in found] == keys


def test_agreement_is_relative_to_the_spread_between_instances():
    """A cosine of 0.7 is normal if instances differ much, and an alarm if they are similar."""
    row = TABLE["features.agreement"]
    assert not row.is_passed(relative_agreement(0.7, 0.2)) and row.is_passed(relative_agreement(0.7, 0.5))
    assert relative_agreement(1.0, 1.0) == 1.0, "equal instances have equal views"


def test_the_page_of_alarms_has_a_row_with_the_range_of_each():
    page = (ROOT / "docs" / "alarms.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| `")]
    assert {cells[0]: cells[2] for cells in rows} == {f"| `{key}`": row.normal for key, row in TABLE.items()}


@pytest.mark.parametrize("key", TABLE)
def test_an_advice_names_keys_and_values_that_exist(key):
    named = re.findall(r"\b([a-z_]+)\.([a-z_0-9]+)\b(?: to ([a-z_0-9]+))?", TABLE[key].advice)
    for section, name, value in named:
        if name not in ("png", "zarr"):
            found = section_keys(section)[name]
            assert not value or "enum" not in found or value in found["enum"]


@pytest.mark.parametrize("alarm", CAUSED)
def test_an_advice_names_the_presets_that_set_what_caused_its_alarm_and_no_others(alarm):
    for key in TABLE[alarm].causes:
        section, name = key.split(".")
        default = section_keys(section)[name]["default"]
        for path in (ROOT / "config" / "presets").glob("*.yaml"):
            value = read_yaml(path).get(section, {}).get(name, default)
            raised = isinstance(value, int) and isinstance(default, int) and value >= default
            named = re.search(rf"presets?[ a-z]* {path.stem}\b", TABLE[alarm].advice)
            is_right = bool(named) == (value != default and not raised)
            assert is_right or len(TABLE[alarm].causes) > 1, (key, path.stem)


@pytest.mark.parametrize("key", [key for key in SHOWN if key != "poses.models"])
def test_a_sentence_shows_no_figure_within_the_normal_range(key):
    text = TABLE[key].sentence.partition("{value")[2].partition("}")[0]
    figures = dict.fromkeys(("cosine", "spread", "points", "after"), 0.0) | {"value": beyond(key, 1e-9)}
    shown = found_text(Alarm(key, figures))
    number = next(float(digits) for digits in re.findall(r"[\d.]+\d|\d", shown))
    assert TABLE[key].is_passed(number / (100 if text.endswith("%") else 1))


def test_a_line_holds_key_figures_range_and_advice():
    alarm = Alarm("masks.pixels", {"value": 0.314, "limit": 0.25})
    (notice, line) = warning_lines("small", [alarm])
    assert notice == "notice: small" and line == f"alarm: {alarm_line(alarm)}"
    assert all(part in line for part in ("masks.pixels", "31.4%", "up to 25%", TABLE["masks.pixels"].advice))
