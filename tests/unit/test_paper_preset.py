"""docs/paper.md says what ``preset: paper`` resolves to, and leaves none of its keys out."""

import re

import pytest
import yaml

from egosplat.pipeline import config
from egosplat.pipeline.model_sets import DEFAULTS
from tests.support import PRESETS, ROOT

FOLLOW = {f"{section}.{name}" for section, keys in DEFAULTS["published"].items() for name in keys}
VALUE = re.compile(r"`(?P<key>[a-z_0-9]+\.[a-z_0-9]+)`(?: \((?P<format>[a-z0-9]+)\))? `(?P<value>.*?)`")


def rows() -> dict[tuple[str, str], str]:
    """Value, as it is written, by format (empty for all) and key."""
    page = (ROOT / "docs" / "paper.md").read_text().partition("\n## The preset `paper`\n")[2]
    cells = [line.split("|")[4] for line in page.splitlines() if line.startswith("| ")]
    found = [match for cell in cells for match in VALUE.finditer(cell)]
    keys = [(match["format"] or "", match["key"]) for match in found]
    assert len(keys) == len(set(keys)) > 40
    return dict(zip(keys, (match["value"] for match in found), strict=True))


@pytest.mark.parametrize("format, key", rows())
def test_a_value_in_the_table_is_what_the_preset_resolves_to(format, key):
    resolved = config.of_format(config.resolve({"preset": "paper"}, PRESETS), format)
    section, name = key.split(".")
    written = yaml.safe_load(rows()[format, key])
    value = resolved[section][name]
    assert value == written and isinstance(value, bool) == isinstance(written, bool)


def test_every_key_of_the_preset_and_of_its_models_is_in_the_table():
    preset = yaml.safe_load((PRESETS / "paper.yaml").read_text())
    by_format = {"": preset, **preset.pop("formats")}
    expected = {
        (format, f"{section}.{name}")
        for format, sections in by_format.items()
        for section, keys in sections.items()
        for name in keys
    }
    expected |= {("", key) for key in FOLLOW}
    assert len(expected) > 40 and expected <= set(rows())


def test_no_preset_sets_a_key_that_follows_the_models():
    for path in PRESETS.glob("*.yaml"):
        preset = yaml.safe_load(path.read_text())
        parts = [preset, *preset.pop("formats", {}).values()]
        found = {f"{section}.{name}" for part in parts for section, keys in part.items() for name in keys}
        assert found and not found & FOLLOW, path.name
