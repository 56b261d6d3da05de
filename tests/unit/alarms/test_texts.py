"""The words of alarms: on every page one line each, in docs/alarms.md one row each, and none in what a stage executes."""

import re
from pathlib import Path

import pytest

from egosplat.alarms.limits import CAUSING_KEYS, LIMITS, Alarm
from egosplat.alarms.texts import TEXTS, alarm_line, alarm_table, found_text, normal_range, warning_lines
from egosplat.pipeline.code_hash import NEUTRAL
from egosplat.pipeline.config import read_yaml, section_keys

ROOT = Path(__file__).resolve().parents[3]


def test_the_page_of_alarms_holds_the_table():
    page = (ROOT / "docs" / "alarms.md").read_text(encoding="utf-8")
    assert alarm_table() in page, "write it again: python -m egosplat.alarms.texts"


def test_every_limit_has_words():
    assert set(TEXTS) - set(LIMITS) == {"masks.withheld", "metrics.chance"}, "their limits are no constants"


def test_the_normal_range_follows_the_limit():
    assert normal_range("masks.pixels") == "up to 25%" and normal_range("splats.psnr") == "20 dB or more"


@pytest.mark.parametrize("key", TEXTS)
def test_an_advice_names_keys_and_values_that_exist(key):
    for section, name, value in re.findall(
        r"\b([a-z_]+)\.([a-z_0-9]+)\b(?: to ([a-z_0-9]+))?", TEXTS[key].advice
    ):
        if name not in ("png", "zarr"):
            found = section_keys(section)[name]
            assert not value or "enum" not in found or value in found["enum"]


@pytest.mark.parametrize("alarm", CAUSING_KEYS)
def test_an_advice_names_the_presets_that_set_what_caused_its_alarm(alarm):
    """A preset that lowers a number, or chooses another word, than the default."""
    for key in CAUSING_KEYS[alarm]:
        section, name = key.split(".")
        default = section_keys(section)[name]["default"]
        for path in (ROOT / "config" / "presets").glob("*.yaml"):
            value = read_yaml(path).get(section, {}).get(name, default)
            raised = isinstance(value, int) and isinstance(default, int) and value >= default
            if value != default and not raised:
                assert re.search(rf"presets?[ a-z]* {path.stem}\b", TEXTS[alarm].advice), (key, path.stem)


@pytest.mark.parametrize("key", sorted(set(LIMITS) - {"instances.masks_kept", "poses.models"}))
def test_a_sentence_shows_no_figure_within_the_normal_range(key):
    """Not even where rounding would bring it there."""
    limit = LIMITS[key]
    if "{value" not in TEXTS[key].found:
        return
    text = TEXTS[key].found.partition("{value")[2].partition("}")[0]
    value = limit.value + (1e-9 if limit.normal_is_below else -1e-9)
    figures = dict.fromkeys(("cosine", "spread", "points"), 0.0) | {"value": value}
    shown = found_text(Alarm(key, figures))
    percent = text.endswith("%")
    number = next(float(one) / (100 if percent else 1) for one in re.findall(r"[\d.]+\d|\d", shown))
    assert limit.is_passed(number)


def test_a_line_holds_key_figures_range_and_advice():
    alarm = Alarm("masks.pixels", {"value": 0.314, "limit": 0.25})
    (notice, line) = warning_lines("small", [alarm])
    assert notice == "notice: small" and line == f"alarm: {alarm_line(alarm)}"
    assert all(part in line for part in ("masks.pixels", "31.4%", "25%", TEXTS["masks.pixels"].advice))


def test_a_number_that_json_cannot_hold_is_told():
    assert "nan dB" in alarm_line(Alarm("splats.psnr", {"value": None, "limit": 20.0}))


def test_the_words_are_no_part_of_the_code_of_a_stage():
    assert "egosplat.alarms.texts" in NEUTRAL
