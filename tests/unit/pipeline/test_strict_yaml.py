"""YAML files: repeated keys are rejected, 1e-4 is a number, and errors name line and column."""

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.strict_yaml import load_yaml, read_yaml


@pytest.mark.parametrize(
    "text, where",
    [
        ("preset: draft\nframes: {}\npreset: paper\n", "line 3, column 1: .*'preset'"),
        ("splats:\n  iterations: 5\n  seed: 1\n  iterations: 6\n", "line 4, column 3: .*'iterations'"),
        ("frames: {stride: 1, stride: 2}\n", "line 1, column 21: .*'stride'"),
        ('{"frames": {"stride": 2, "stride": 3}}', "line 1, column 26: .*'stride'"),
        ("frames: [", "line 1, column 10"),
        ("frames:\n  stride: 2\n\tfocal: 3\n", r"line 3, column 1: found character '\\t'"),
        ("a: 1\nb: *nothing\n", "line 2, column 4: found undefined alias"),
        ("a: 1\n---\nb: 2\n", "line 2, column 1"),
        ("a: 1\nb: 'x\n", "line 3, column 1"),
        ("[" * 5000, "recursion"),
        ("- 1", "list"),
    ],
)
def test_a_faulty_file_is_named_with_line_and_column(tmp_path, text, where):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=f"mine.yaml: .*{where}"):
        read_yaml(tmp_path / "mine.yaml")


def test_keys_of_several_mappings_and_merged_ones_may_be_alike():
    assert load_yaml("a: {x: 1}\nb: {x: 2}\n") == {"a": {"x": 1}, "b": {"x": 2}}
    assert load_yaml("a: &a {x: 1}\nb: {<<: *a, x: 2}\n")["b"] == {"x": 2}


@pytest.mark.parametrize(
    "text, value",
    [("1e-4", 1e-4), ("5E3", 5000.0), ("-2.e2", -200.0), (".5e1", 5.0), ("1e", "1e"), ("12", 12)],
)
def test_numbers_with_an_exponent_are_numbers(text, value):
    found = load_yaml(text)
    assert found == value and type(found) is type(value)
