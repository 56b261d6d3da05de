"""Parsed modules are kept in a file of the user's cache, which changes no hash."""

import json

import pytest

from egosplat.pipeline import parsed_modules
from egosplat.pipeline.parsed_modules import keep_parsed, parse_module

SOURCE = "import pkg.first\n\ndef run():\n    from . import second\n"


def forget() -> None:
    """Forget everything but the file."""
    parsed_modules._kept.cache_clear()
    parse_module.cache_clear()


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of package ``pkg``, and an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    forget()
    path = tmp_path / "stage.py"
    path.write_text(SOURCE)
    yield path
    forget()


def test_a_kept_module_is_not_parsed_again(module, monkeypatch):
    first = parse_module("pkg.stage", module)
    assert first.imports == ("pkg.first", "pkg", "pkg.second")
    keep_parsed()
    forget()
    monkeypatch.setattr(parsed_modules.ast, "parse", lambda _: pytest.fail("parsed again"))
    assert parse_module("pkg.stage", module) == first


def test_an_edited_module_is_parsed_again(module):
    first = parse_module("pkg.stage", module)
    keep_parsed()
    forget()
    module.write_text(SOURCE + "X = 1\n")
    assert parse_module("pkg.stage", module).tree_hash != first.tree_hash


def test_the_same_text_in_another_package_imports_other_modules(module):
    parse_module("pkg.stage", module)
    keep_parsed()
    forget()
    assert "other.second" in parse_module("other.stage", module).imports


def test_a_definition_counts_with_what_it_needs(module):
    module.write_text("from pkg import a, b\nN = 1\nX = a(N)\nY = b()\n")
    (x, y), changed = (parse_module(f"pkg.stage.{name}", module) for name in "XY"), module.read_text()
    assert x.imports == ("pkg", "pkg.a") and y.imports == ("pkg", "pkg.b")
    for old, new, stale in (("N = 1", "N = 2", [True, False]), ("b()", "b(1)", [False, True])):
        module.write_text(changed.replace(old, new))
        forget()
        assert [parse_module(f"pkg.stage.{n}", module) != was for n, was in (("X", x), ("Y", y))] == stale


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_a_damaged_file_is_replaced(module, text):
    file = parsed_modules._file()
    file.parent.mkdir(parents=True)
    file.write_text(text)
    first = parse_module("pkg.stage", module)
    keep_parsed()
    assert [first.tree_hash, [*first.imports]] in json.loads(file.read_text()).values()


def test_the_file_holds_the_latest_modules(module, monkeypatch):
    monkeypatch.setattr(parsed_modules, "MOST_MODULES", 2)
    for text in ("A = 1", "A = 2", "A = 3"):
        module.write_text(text)
        parse_module.cache_clear()
        latest = parse_module("pkg.stage", module)
        keep_parsed()
    kept = json.loads(parsed_modules._file().read_text())
    assert len(kept) == 2 and [*kept.values()][-1] == [latest.tree_hash, []]


def test_without_a_folder_to_write_in_modules_are_parsed_each_time(module, monkeypatch):
    (module.parent / "cache").write_text("a file in place of the folder")
    first = parse_module("pkg.stage", module)
    keep_parsed()
    forget()
    assert parse_module("pkg.stage", module) == first
