"""Every link of the documentation opens, and docs/method.md names functions, keys, values and arrays that exist."""

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

from egosplat import config
from egosplat.schema_files import schema

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "config/*.md", "benchmarks/**/*.md", "training/*.md")
    for path in ROOT.glob(pattern)
)
SOURCES = sorted(
    path
    for folder in ("src", "tests", "benchmarks", "training", "config", "docs", "workflow")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".py", ".md", ".yaml", ".yml", ".smk", ".h", ".cpp", ".tsv"}
    or path.name == "Snakefile"
)
LINK = re.compile(r"\]\(([^)\s]+)\)")
METHOD = "docs/method.md"


def prose(page: str) -> str:
    """A page without its code blocks, whose lines are neither headings nor links."""
    return re.sub(r"^```.*?^```", "", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL)


@cache
def anchors(page: str) -> frozenset[str]:
    """The page's explicit ids, and GitHub's slug of each heading."""
    text, found = prose(page), []
    for heading in re.findall(r"^#+ +(.*?) *$", text, re.MULTILINE):
        shown = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", shown).replace(" ", "-")
        found.append(f"{slug}-{found.count(slug)}" if slug in found else slug)
    return frozenset(found) | frozenset(re.findall(r'<a id="([^"]+)">', text))


def broken_link(page: str, target: str) -> bool:
    """Whether a relative link of a page leads to no file, or to no anchor of it."""
    name, _, anchor = target.partition("#")
    path = (ROOT / page).parent / name if name else ROOT / page
    if not path.exists():
        return True
    return bool(anchor) and anchor not in anchors(path.resolve().relative_to(ROOT).as_posix())


@pytest.mark.parametrize("page", PAGES)
def test_every_relative_link_opens(page):
    """A file that was moved, or a heading that was renamed, breaks no link."""
    links = [link for link in LINK.findall(prose(page)) if not re.match(r"[a-z]+:", link)]
    assert [link for link in links if broken_link(page, link)] == []


def test_every_anchor_that_sources_name_exists():
    """Docstrings, comments and descriptions cite anchors of pages in docs/; each of them opens."""
    cited = {
        (path.relative_to(ROOT).as_posix(), page, anchor)
        for path in SOURCES
        for page, anchor in re.findall(r"\b(docs/\w+\.md)#([\w-]+)", path.read_text())
    }
    assert len(cited) > 50
    assert (
        sorted(one for one in cited if not (ROOT / one[1]).is_file() or one[2] not in anchors(one[1])) == []
    )


def test_no_citation_of_a_document_that_readers_do_not_have():
    """The paper's readings are cited by docs/method.md, not by the numbers of an unpublished note."""
    citation = re.compile(r"method_spec|\bM[1-9](?:\.[0-9]| no\.)|\(M[1-9]\)")
    pages = [ROOT / "README.md", ROOT / "CHANGELOG.md", *SOURCES]
    left = [path for path in pages if path != Path(__file__) and citation.search(path.read_text())]
    assert left == []


def test_method_names_functions_that_exist():
    """A function that is renamed or moved is renamed in docs/method.md too."""
    named = re.findall(r"\[`(\w+)`\]\(\.\./(src/[\w/]+\.py)\)", prose(METHOD))
    assert len(named) > 60
    defined = r"^(?:class |def ){0}\b|^{0}(?::.*)? = "
    lost = [
        (name, path)
        for name, path in named
        if not re.search(defined.format(name), (ROOT / path).read_text(), re.MULTILINE)
    ]
    assert lost == []


@cache
def values(preset: str) -> dict[str, Any]:
    """Every key of every section as ``section.key``, as a preset has it."""
    resolved = config.resolve({"preset": preset}, ROOT / "config" / "presets")
    sections = {name: keys for name, keys in resolved.items() if isinstance(keys, dict)}
    return {f"{section}.{key}": value for section, keys in sections.items() for key, value in keys.items()}


def test_method_names_keys_that_exist():
    """A key that is renamed is renamed in docs/method.md too."""
    known = values("balanced")
    sections = {key.partition(".")[0] for key in known}
    named = set(re.findall(r"`([a-z_]+)\.([a-z_0-9]+)`", prose(METHOD)))
    keys = {
        f"{section}.{key}" for section, key in named if section in sections and key not in ("zarr", "json")
    }
    assert len(keys) > 60
    assert keys - set(known) == set()


def test_method_names_arrays_that_exist():
    """An array that is renamed is renamed in docs/method.md too."""
    text = prose(METHOD)
    arrays = set(re.findall(r"`(\w+)\.zarr/([\w/]+)`", text))
    entries = set(re.findall(r"`(\w+)\.json/(\w+)`", text))
    assert len(arrays) > 30 and len(entries) > 4
    for artifact, name in sorted(arrays):
        fields = getattr(import_module(f"egosplat.artifacts.{artifact}"), artifact.upper()).fields
        assert name in fields, (artifact, name)
    for document, name in sorted(entries):
        assert name in schema(document)["properties"], (document, name)


def readings() -> list[tuple[str, str]]:
    """The cells ``default`` and ``paper`` of every row of docs/method.md that has both."""
    rows, places = [], None
    for line in prose(METHOD).splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)]
        if len(cells) < 3:
            places = None
        elif "default" in cells and "paper" in cells:
            places = cells.index("default"), cells.index("paper")
        elif places and "---" not in cells:
            rows.append((cells[places[0]], cells[places[1]]))
    return rows


def stated(cell: str) -> dict[str, Any]:
    """The values that a cell gives for keys: `section.key` value."""
    found = re.findall(r"`([a-z_]+\.[a-z_0-9]+)` ([^\s;:|]+)", cell)
    return {key: value_of(text) for key, text in found if key in values("balanced")}


def value_of(text: str) -> Any:
    """What is written: a number, a truth value, null or a word."""
    text = text.rstrip(".,;:)")
    return yaml.safe_load(text.replace(",", "") if text[0].isdigit() else text)


def agrees(written: Any, value: Any) -> bool:
    """Whether a written value is the key's; of a list its only entry."""
    return written == (value[0] if isinstance(value, list) else value)


def test_method_gives_the_values_that_presets_have():
    """Both columns of the readings are what the default preset and ``preset: paper`` resolve to."""
    default, paper = values("balanced"), values("paper")
    wrong, checked = [], 0
    for usual, printed in readings():
        own, papers = stated(usual), stated(printed)
        if printed.startswith("the same"):
            papers = own
        elif len(own) == 1 and not papers and not printed.startswith("not "):
            papers = dict.fromkeys(own, value_of(printed.split()[0]))
        for cell, preset in ((own, default), (papers, paper)):
            checked += len(cell)
            wrong += [
                (key, written, preset[key])
                for key, written in cell.items()
                if not agrees(written, preset[key])
            ]
    assert checked > 100
    assert wrong == []
