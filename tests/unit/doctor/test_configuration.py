"""The doctor reads the configuration that the workflow would read."""

import pytest

from egosplat.doctor.inputs import read_configuration
from egosplat.errors import UserError
from tests.support import ROOT


def test_defaults_hold_without_a_file(folder):
    config, sources = read_configuration([], [])
    assert config["preset"] == "balanced" and sources == [str(ROOT / "config/config.yaml")]


def test_options_override_files_and_later_files_earlier_ones(folder):
    (folder / "config").mkdir()
    (folder / "config/config.yaml").write_text("preset: draft\nsplats: {iterations: 1}\nrun: {seed: 1}\n")
    for name, seed in (("a", 2), ("b", 3)):
        (folder / f"{name}.yaml").write_text(f"run: {{seed: {seed}}}\nsplats: {{max_points: {seed}}}")
    files = [folder / "a.yaml", folder / "b.yaml"]
    config, sources = read_configuration(files, ["splats={max_points: 9}", "preset=paper"])
    assert config["preset"] == "paper" and config["synthetic"]["size"] == 1408
    assert (config["splats"]["iterations"], config["splats"]["max_points"], config["run"]["seed"]) == (
        1,
        9,
        3,
    )
    assert sources == ["config/config.yaml", *map(str, files), "splats={max_points: 9}", "preset=paper"]


@pytest.mark.parametrize("option", ["draft", "=draft", "preset=", "models={a: [", ".a=1", "splats.=1"])
def test_a_malformed_option_is_an_error(folder, option):
    with pytest.raises(UserError, match="KEY=VALUE"):
        read_configuration([], [option])


@pytest.mark.parametrize(
    "options, section, key, value",
    [
        (["splats.iterations=5"], "splats", "iterations", 5),
        (["splats={iterations: 5}"], "splats", "iterations", 5),
        (["splats={iterations: 4}", "splats.iterations=5"], "splats", "iterations", 5),
        (["frames.end_s=null"], "frames", "end_s", None),
        (["variants.mine.splats.iterations=7"], "variants", "mine", {"splats": {"iterations": 7}}),
    ],
)
def test_keys_of_a_section_may_be_written_with_a_dot(folder, options, section, key, value):
    config, _ = read_configuration([], options)
    assert config[section][key] == value and config["run"]["seed"] == 0
