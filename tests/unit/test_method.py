"""docs/method.md and docs/paper.md name functions, keys, values and arrays that exist."""

import re
from functools import cache
from typing import Any

import yaml

from egosplat.artifacts.schemas import SCHEMAS
from egosplat.pipeline import config
from egosplat.pipeline.validation import schema
from tests.support import ROOT


def prose() -> str:
    """The pages without their blocks of code."""
    page = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("method.md", "paper.md"))
    return re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)


def test_the_page_names_functions_that_exist():
    named = re.findall(r"\[`(\w+)`\]\(\.\./(src/[\w/]+\.py)\)", prose())
    assert len(named) > 60
    for name, path in named:
        defined = rf"^(?:class |def ){name}\b|^{name}(?::.*)? = "
        assert re.search(defined, (ROOT / path).read_text(), re.MULTILINE), (name, path)


@cache
def values(preset: str) -> dict[str, Any]:
    """Every key of every section as ``section.key``, as a preset has it."""
    resolved = config.resolve({"preset": preset}, ROOT / "config" / "presets")
    sections = {name: keys for name, keys in resolved.items() if isinstance(keys, dict)}
    return {f"{section}.{key}": value for section, keys in sections.items() for key, value in keys.items()}


def test_the_page_names_arrays_that_exist():
    text = prose()
    arrays = set(re.findall(r"`(\w+)\.zarr/([\w/]+)`", text))
    entries = set(re.findall(r"`(\w+)\.json/(\w+)`", text))
    assert len(arrays) > 30 and len(entries) > 4
    for artifact, name in sorted(arrays):
        assert name in SCHEMAS[artifact].fields, (artifact, name)
    for document, name in sorted(entries):
        assert name in schema(document)["properties"], (document, name)


def readings() -> list[tuple[str, str]]:
    """Of every item of docs/method.md what is the default, and the sentence after "Paper:"; empty if the paper has the same."""
    items = [line.partition("Paper: ") for line in prose().splitlines() if line.startswith("- ")]
    return [(default, re.split(r"[.](?: |$)", printed)[0]) for default, _, printed in items]


def stated(cell: str) -> dict[str, Any]:
    """The values that a text gives for keys: `section.key` value."""
    found = re.findall(r"`([a-z_]+\.[a-z_0-9]+)` ([^\s;:|]+)", cell)
    return {key: value_of(text) for key, text in found if key in values("balanced")}


def value_of(text: str) -> Any:
    """The value that a text means: a number, a truth value, null or a word."""
    text = text.rstrip(".,;:)")
    return yaml.safe_load(text.replace(",", "") if text[0].isdigit() else text)


def agrees(written: Any, value: Any) -> bool:
    """Whether a written value is the key's; of a list its only entry."""
    return written == (value[0] if isinstance(value, list) else value)


def test_the_page_gives_the_values_that_presets_have():
    default, paper = values("balanced"), values("paper")
    wrong, checked = [], 0
    for usual, printed in readings():
        own, papers = stated(usual), stated(printed)
        if not printed:
            papers = own
        elif len(own) == 1 and not papers:
            papers = dict.fromkeys(own, value_of(printed.split()[0]))
        for cell, preset in ((own, default), (papers, paper)):
            checked += len(cell)
            wrong += [(key, value) for key, value in cell.items() if not agrees(value, preset[key])]
    assert checked > 75 and wrong == []
