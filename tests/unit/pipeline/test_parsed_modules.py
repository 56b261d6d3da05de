"""Parsed modules are kept in the user's cache, which changes no hash."""

import pytest

from egosplat.pipeline import parsed_modules
from egosplat.pipeline.parsed_modules import parse_module

SOURCE = "import pkg.first\n\ndef run():\n    from . import second\n"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of package ``pkg``, and an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    parse_module.cache_clear()
    path = tmp_path / "stage.py"
    path.write_text(SOURCE)
    yield path
    parse_module.cache_clear()


def test_a_kept_module_is_not_parsed_again(module, monkeypatch):
    first = parse_module("pkg.stage", module)
    assert first.imports == ("pkg.first", "pkg", "pkg.second")
    parse_module.cache_clear()
    monkeypatch.setattr(parsed_modules.ast, "parse", lambda _: pytest.fail("parsed again"))
    assert parse_module("pkg.stage", module) == first


def test_an_edited_module_and_one_of_another_package_are_parsed_again(module):
    first = parse_module("pkg.stage", module)
    assert "other.second" in parse_module("other.stage", module).imports
    parse_module.cache_clear()
    module.write_text(SOURCE + "X = 1\n")
    assert parse_module("pkg.stage", module).tree_hash != first.tree_hash


def test_a_definition_counts_with_what_it_needs(module):
    module.write_text("from pkg import a, b\nN = 1\nX = a(N)\nY = b()\n")
    (x, y), changed = (parse_module(f"pkg.stage.{name}", module) for name in "XY"), module.read_text()
    assert x.imports == ("pkg", "pkg.a") and y.imports == ("pkg", "pkg.b")
    for old, new, stale in (("N = 1", "N = 2", [True, False]), ("b()", "b(1)", [False, True])):
        module.write_text(changed.replace(old, new))
        parse_module.cache_clear()
        assert [parse_module(f"pkg.stage.{n}", module) != was for n, was in (("X", x), ("Y", y))] == stale


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_a_damaged_file_is_replaced(module, text):
    first = parse_module("pkg.stage", module)
    (file,) = (module.parent / "cache/egosplat/modules").iterdir()
    whole = file.read_text()
    file.write_text(text)
    parse_module.cache_clear()
    assert parse_module("pkg.stage", module) == first and file.read_text() == whole


def test_without_a_folder_to_write_in_modules_are_parsed_each_time(module):
    (module.parent / "cache").write_text("a file in place of the folder")
    first = parse_module("pkg.stage", module)
    parse_module.cache_clear()
    assert parse_module("pkg.stage", module) == first
