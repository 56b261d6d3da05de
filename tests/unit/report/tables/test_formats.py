"""A table in each format, with names that mean something in it."""

import io
import re
from html.parser import HTMLParser

import pandas as pd
import pytest

from egosplat.report.tables.formats import latex, markdown, to_csv, to_latex, to_markdown
from egosplat.report.tables.page import Picture, to_html
from egosplat.report.tables.table import Block, Cell, Column, Note, Row, Table

HOSTILE = '<script>alert("1")</script> & \\input{x} | a_b % $x$ #1 ~ ^ *b* `c` [d](e)'

COLUMNS = tuple(
    Column("average", metric, "all", over, metric)
    for metric, over in (("accuracy", "Acc (%)"), ("mean_iou", "mIoU (%)"))
)


def row(label: str, *cells: Cell) -> Row:
    return Row(label, label, "ADT", "", "full", (True, False), cells)


@pytest.fixture
def table() -> Table:
    scenes = ("scene1", "scene2")
    cells = (
        Cell(40.0, (30.0, 52.0), 80, 20, scenes),
        Cell(12.3456, (10.0, 15.0), 40, 10, ("scene1",), rank=2),
    )
    blocks = (
        Block("printed", "Printed", (row("LERF", Cell(67.5, mark="a", rank=1), Cell(0.0)),)),
        Block("synthetic", "Synthetic: not ADT", (row(HOSTILE, *cells), row("none", Cell(), Cell()))),
    )
    notes = (Note("a", "Odd & strange_one."), Note("", "Another."))
    return Table("ablation", "A caption.", ("One", "Two"), COLUMNS, blocks, notes, ("scene1", "scene2", "x"))


class Page(HTMLParser):
    """What a browser would see: elements that are open, all tags, all text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.text: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def page_of(table: Table, pictures=()) -> Page:
    found = Page(to_html([table], [], pictures, 0.95))
    assert not found.open
    return found


def test_html_shows_hostile_names_as_text(table):
    page = page_of(table, [Picture(f'"><img src=x onerror=1>{HOSTILE}', "data:image/png;base64,AAAA")])
    assert not any(tag == "script" for tag, _ in page.tags)
    assert [attributes.get("src") for tag, attributes in page.tags if tag == "img"] == [
        "data:image/png;base64,AAAA"
    ]
    assert any(text.startswith(f"{HOSTILE}, average of 2 of 3 scenes") for text in page.text)
    assert not any(key.startswith("on") for _, attributes in page.tags for key in attributes)


def test_html_is_self_contained(table):
    page = page_of(table)
    for tag, attributes in page.tags:
        assert tag not in ("link", "script", "iframe")
        assert not {"src", "href"} & set(attributes)
    policy = next(one["content"] for tag, one in page.tags if "http-equiv" in one)
    assert policy.startswith("default-src 'none'")


def test_html_separates_blocks_and_shows_intervals(table):
    page = page_of(table)
    assert [one.get("class") for tag, one in page.tags if tag == "tbody"] == ["printed", "synthetic"]
    assert {"30.0–52.0", "10.0–15.0"} <= set(page.text)
    titles = [one["title"] for tag, one in page.tags if tag == "td" and "title" in one]
    assert titles == ["80 queries of 20 categories", "40 queries of 10 categories"]


def test_html_rows_have_as_many_cells_as_columns(table):
    text = to_html([table], [], [], None)
    body = text[text.index('<tbody class="synthetic">') :]
    for line in body.split("<tr>")[2:]:
        assert line.count("<td") == len(table.components) + len(table.columns)


def test_markdown_shows_ranks_notes_and_intervals(table):
    text = to_markdown(table)
    assert "| ✓ |  | LERF | **67.5**<sup>a</sup> | 0.0 |" in text
    assert "average of 2 of 3 scenes | 40.0 (30.0–52.0) | *12.3* (10.0–15.0) (of 1) |" in text
    assert "| none | - | - |" in text
    assert "- <sup>a</sup> Odd &amp; strange\\_one.\n- Another." in text
    assert "**Synthetic: not ADT**" in text and "<script" not in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in rows} == {6}


def test_markdown_of_many_columns_has_no_room_for_intervals(table):
    cells = tuple(Cell(40.0, (30.0, 52.0), 80, 20) for _ in range(18))
    wide = Table("t", "c", (), COLUMNS * 9, (Block("real", "b", (row("m", *cells),)),), (), ())
    assert "30.0" not in to_markdown(wide)


@pytest.mark.parametrize("special", "\\`*_{}[]|~$#<>&")
def test_markdown_escapes(special):
    escaped = markdown(f"a{special}b")
    assert escaped in (f"a\\{special}b", {"<": "a&lt;b", ">": "a&gt;b", "&": "a&amp;b"}.get(special))


def test_latex_shows_ranks_and_notes(table):
    text = to_latex(table)
    assert r"\checkmark &  & LERF & \textcolor[rgb]{1,0,0}{\textbf{67.5}}\textsuperscript{a} & 0.0 \\" in text
    assert r"\textcolor[rgb]{0,.502,.502}{\textbf{12.3}} (of 1) \\" in text
    assert r"\multicolumn{5}{l}{\textit{Synthetic: not ADT}} \\" in text
    assert r"Odd \& strange\_one." in text and r"\label{tab:ablation}" in text
    assert r"\input" not in text and "<script" not in text
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
    assert {len(re.findall(r"(?<!\\)&", line)) for line in rows} == {4}


@pytest.mark.parametrize("special", "{}$&#_%")
def test_latex_escapes_with_a_backslash(special):
    assert latex(f"a{special}b") == f"a\\{special}b"


@pytest.mark.parametrize("special", '\\~^<>|"')
def test_latex_names_characters_without_an_escape(special):
    assert re.fullmatch(r"a\\text[a-z]+\{\}b", latex(f"a{special}b"))


def test_csv_holds_every_number_of_a_cell(table):
    found = pd.read_csv(io.StringIO(to_csv(table)))
    assert len(found) == 6 and list(found["kind"].unique()) == ["printed", "synthetic"]
    first = found[found.method == HOSTILE].iloc[0]
    assert (first.percent, first.low, first.high) == (40.0, 30.0, 52.0)
    assert (first.queries, first.categories) == (80, 20)
    assert (first.scenes, first.steps, first.data) == ("scene1 scene2", "One", "ADT")
    assert found[found.method == "none"].percent.isna().all()
    assert found.percent.dropna().tolist() == [67.5, 0.0, 40.0, 12.346]


@pytest.mark.parametrize("name", ["=1+1", "+a", "-a", "@a"])
def test_csv_holds_no_formulas(table, name):
    blocks = (Block("real", "b", (row(name, Cell(), Cell()),)),)
    text = to_csv(Table("t", "c", table.components, COLUMNS, blocks, (), ()))
    assert pd.read_csv(io.StringIO(text)).method.unique().tolist() == [f"'{name}"]
