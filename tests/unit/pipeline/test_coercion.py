"""Strings that Snakemake passes for numbers, booleans and null get the types of the schema."""

from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import coerced, resolve

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"


@pytest.mark.parametrize(
    "section, key, text, value",
    [
        ("splats", "iterations", "5", 5),
        ("splats", "position_lr", "1e-4", 1e-4),
        ("splats", "position_lr", "0.002", 0.002),
        ("splats", "densify_init", "false", False),
        ("splats", "sh_degree", "2", 2),
        ("features", "dims", "auto", "auto"),
        ("frames", "end_s", "null", None),
        ("frames", "end_s", "4", 4),
        ("data_root", "adt", "null", None),
        ("data_root", "adt", "5", "5"),
        ("tradeoff", "seeds", ["1", "2"], [1, 2]),
        ("tradeoff", "sweep", {"splats.iterations": ["5", "6"]}, {"splats.iterations": [5, 6]}),
        ("variants", "mine", {"splats": {"iterations": "7"}}, {"splats": {"iterations": 7}}),
        ("query", "canonical", ["5", "null"], ["5", "null"]),
        ("models", "device", "auto", "auto"),
    ],
)
def test_a_text_is_read_as_the_schema_wants_it(section, key, text, value):
    found = resolve({section: {key: text}}, PRESETS)[section][key]
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize("text", ["five", "5 000", "3.0", ".inf", "1e400", "[5]", "", "2020-01-01"])
def test_a_text_that_is_no_such_value_is_rejected_with_its_key(text):
    with pytest.raises(UserError, match=r"splats\.iterations = .*whole number"):
        resolve({"splats": {"iterations": text}}, PRESETS)


def test_a_self_referencing_yaml_alias_terminates():
    loop: dict = {}
    loop["variants"] = {"a": loop}
    loop["frames"] = {"stride": loop}
    assert coerced(loop).keys() == loop.keys()
