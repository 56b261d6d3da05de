"""Strings that Snakemake passes for numbers, booleans and null get the types of the keys."""

from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import resolve
from egosplat.pipeline.variants import variant_config

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"


@pytest.mark.parametrize(
    "section, key, text, value",
    [
        ("splats", "iterations", "5", 5),
        ("language", "lr", "1e-4", 1e-4),
        ("splats", "densify_init", "false", False),
        ("splats", "sh_degree", "2", 2),
        ("features", "dims", "7", 7),
        ("frames", "end_s", "null", None),
        ("camera", "refine_poses", True, "on"),
        ("data_root", "adt", "null", None),
        ("data_root", "adt", "5", "5"),
        ("query", "canonical", ["5", "null"], ["5", "null"]),
    ],
)
def test_a_text_is_read_as_the_key_wants_it(section, key, text, value):
    found = resolve({section: {key: text}}, PRESETS)[section][key]
    assert found == value and type(found) is type(value)


def test_a_text_in_a_variant_is_read_as_the_key_wants_it():
    config = resolve({"variants": {"mine": {"splats": {"iterations": "7"}}}}, PRESETS)
    assert variant_config(config, "mine", "scene")["splats"]["iterations"] == 7


@pytest.mark.parametrize("text", ["five", "3.0", "1e400", "[5]", "", "2020-01-01"])
def test_a_text_that_is_no_such_value_is_rejected_with_its_key(text):
    with pytest.raises(UserError, match=r"splats\.iterations = .*whole number"):
        resolve({"splats": {"iterations": text}}, PRESETS)


@pytest.mark.parametrize("value", [True, 3.0, float("nan"), float("inf"), 2**31, -1])
def test_a_value_of_another_type_is_rejected(value):
    """A boolean is no number, and 3.0 no whole one."""
    with pytest.raises(UserError, match=r"splats\.max_points = .*whole number"):
        resolve({"splats": {"max_points": value}}, PRESETS)
