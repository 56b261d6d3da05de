"""YAML files: repeated keys are rejected, 1e-4 is a number, and errors name line and column."""

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import read_yaml
from egosplat.pipeline.strict_yaml import load_yaml

TWICE = [
    ("preset: draft\nframes: {}\npreset: paper\n", "line 3, column 1: .*'preset' .* line 1"),
    ("splats:\n  iterations: 5\n  seed: 1\n  iterations: 6\n", "line 4, column 3: .*'iterations' .* line 2"),
    ("frames: {stride: 1, stride: 2}\n", "line 1, column 21: .*'stride' .* line 1"),
    ("frames: {stride: 1}\n\nframes: {focal: 400}\n", "line 3, column 1: .*'frames' .* line 1"),
]


@pytest.mark.parametrize("text, message", TWICE)
def test_a_key_that_stands_twice_is_named_with_both_lines(tmp_path, text, message):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=f"mine.yaml: .*{message}"):
        read_yaml(tmp_path / "mine.yaml")


def test_keys_of_several_mappings_and_merged_ones_may_be_alike():
    assert load_yaml("a: {x: 1}\nb: {x: 2}\n") == {"a": {"x": 1}, "b": {"x": 2}}
    assert load_yaml("a: &a {x: 1}\nb: {<<: *a, x: 2}\n")["b"] == {"x": 2}


@pytest.mark.parametrize(
    "text, where",
    [
        ("frames: [", "line 1, column 10"),
        ("frames:\n  stride: 2\n\tfocal: 3\n", r"line 3, column 1: found character '\\t'"),
        ("a: 1\nb: *nothing\n", "line 2, column 4: found undefined alias"),
        ("a: 1\n---\nb: 2\n", "line 2, column 1: expected a single document"),
        ("a: 1\nb: {c: 2\nd: 3\n", "line 3, column 2"),
        ("a: 1\nb: 'x\n", "line 3, column 1"),
        ("[" * 5000, "nested too deeply"),
    ],
)
def test_a_file_that_is_no_yaml_is_named_with_line_and_column(tmp_path, text, where):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=f"mine.yaml: .*{where}"):
        read_yaml(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    "text, value",
    [("1e-4", 1e-4), ("5E3", 5000.0), ("-2.e2", -200.0), (".5e1", 5.0), ("1e", "1e"), ("12", 12)],
)
def test_numbers_with_an_exponent_are_numbers(text, value):
    found = load_yaml(text)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    "text, where",
    [
        ("splats: {iterations: 010}", "line 1, column 22: 010 is octal"),
        ("variants: {no: {}}", "line 1, column 12: key no is read as bool"),
        ("variants: {123: {}}", "key 123 is read as int"),
        ("null: 3", "key null is read as null"),
        ("frames: &a {stride: *a}", "nested too deeply"),
        ("variants: &a {x: *a}", "nested too deeply"),
    ],
)
def test_what_yaml_reads_as_another_thing_is_named(tmp_path, text, where):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=f"mine.yaml: .*{where}"):
        read_yaml(tmp_path / "mine.yaml")


def test_aliases_that_stand_for_billions_of_values_are_refused(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 10)]
    (tmp_path / "mine.yaml").write_text("\n".join(lines))
    with pytest.raises(UserError, match="100,000"):
        read_yaml(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    "text", ['{\n\t"frames": {"stride": 2}\n}', '\ufeff{"frames": {"stride": 2}}', "{frames: {stride: 2,},}"]
)
def test_json_with_tabs_or_a_mark_is_read(tmp_path, text):
    (tmp_path / "mine.json").write_text(text, encoding="utf-8")
    assert read_yaml(tmp_path / "mine.json") == {"frames": {"stride": 2}}


def test_a_repeated_key_of_json_is_named(tmp_path):
    """Snakemake takes the last one."""
    (tmp_path / "mine.json").write_text('{"frames": {"stride": 2, "stride": 3}}')
    with pytest.raises(UserError, match="'stride' is set twice"):
        read_yaml(tmp_path / "mine.json")
