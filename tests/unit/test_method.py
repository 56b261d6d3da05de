"""docs/method.md, docs/answers.md and docs/paper.md name functions, keys, values and arrays that exist."""

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
    page = "".join(
        (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("method.md", "answers.md", "paper.md")
    )
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


def stated() -> list[tuple[str, str, str]]:
    """Every key for which a text or a table gives values: key, default and the paper's value, empty if it is the same."""
    text = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    inline = re.findall(r"`([a-z_]+\.\w+)` \(([^();]+)(?:; paper: ([^()]+))?\)", text)
    rows = re.findall(r"^\| (?:<a [^>]*></a>)*`([a-z_]+\.\w+)` \| ([^|]+) \| ([^|]*) \|", text, re.MULTILINE)
    return [one for one in (*inline, *rows) if one[0] in values("balanced")]


def value_of(text: str) -> Any:
    """The value that a text means: a number, a truth value, null or a word."""
    text = text.rstrip(".,;:)")
    return yaml.safe_load(text.replace(",", "") if text[0].isdigit() else text)


def agrees(written: Any, value: Any) -> bool:
    """Whether a written value is the key's; of a list its only entry."""
    return written == (value[0] if isinstance(value, list) else value)


def test_the_page_gives_the_values_that_presets_have():
    found = stated()
    wrong = [
        (key, text, preset)
        for key, usual, printed in found
        for preset, text in (("balanced", usual), ("paper", printed or usual))
        if not agrees(value_of(text.split()[0]), values(preset)[key])
    ]
    assert len(found) > 30 and wrong == []
