"""Parsed modules are kept in the user's cache, which changes no hash."""

import pytest

from egosplat.pipeline import parsed_modules
from egosplat.pipeline.parsed_modules import parse_module

SOURCE = "import pkg.first\n\ndef run():\n    from . import second\n"


@pytest.fixture
def parse(tmp_path, monkeypatch):
    """``parse(name)``: the module ``stage.py``, read anew; the user's cache is empty at first."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "stage.py").write_text(SOURCE)

    def anew(name: str = "pkg.stage"):
        parse_module.cache_clear()
        return parse_module(name, tmp_path / "stage.py")

    yield anew
    parse_module.cache_clear()


def test_a_kept_module_is_not_parsed_again(parse, monkeypatch):
    first = parse()
    assert first.imports == ("pkg.first", "pkg", "pkg.second")
    monkeypatch.setattr(parsed_modules.ast, "parse", lambda _: pytest.fail("parsed again"))
    assert parse() == first


def test_an_edited_module_and_one_of_another_package_are_parsed_again(parse, tmp_path):
    first = parse()
    assert "other.second" in parse("other.stage").imports
    (tmp_path / "stage.py").write_text(SOURCE + "X = 1\n")
    assert parse().tree_hash != first.tree_hash


def test_a_definition_counts_with_what_it_needs(parse, tmp_path):
    text = "from pkg import a, b\nN = 1\nX = a(N)\nY = b()\n"
    (tmp_path / "stage.py").write_text(text)
    x, y = parse("pkg.stage.X"), parse("pkg.stage.Y")
    assert x.imports == ("pkg", "pkg.a") and y.imports == ("pkg", "pkg.b")
    for old, new, stale in (("N = 1", "N = 2", (True, False)), ("b()", "b(1)", (False, True))):
        (tmp_path / "stage.py").write_text(text.replace(old, new))
        assert (parse("pkg.stage.X") != x, parse("pkg.stage.Y") != y) == stale


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_a_damaged_file_is_replaced(parse, tmp_path, text):
    first = parse()
    (file,) = (tmp_path / "cache/egosplat/modules").iterdir()
    whole = file.read_text()
    file.write_text(text)
    assert parse() == first and file.read_text() == whole


def test_without_a_folder_to_write_in_modules_are_parsed_each_time(parse, tmp_path):
    (tmp_path / "cache").write_text("a file in place of the folder")
    assert parse() == parse()
