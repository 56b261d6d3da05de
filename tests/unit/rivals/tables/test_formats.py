"""A table in each format, with names that mean something in it."""

import html
import io
import re

import pandas as pd
import pytest

from egosplat_rivals.scored_scenes import Cell
from egosplat_rivals.tables.formats import to_csv, to_html
from egosplat_rivals.tables.stage import write_page
from egosplat_rivals.tables.table import Layout, Note, Row

HOSTILE = '<script>alert("1")</script> & \\input{x} | a_b % $x$ #1 ~ ^ *b* `c` [d](e)'

COLUMNS = (("average", "accuracy", "all"), ("average", "mean_iou", "all"))
HEADINGS = (("Acc (%)", "accuracy"), ("mIoU (%)", "mean_iou"))
PAPER, OTHER = ("printed", "Printed"), ("synthetic", "Synthetic: not ADT")
CELLS = (
    Cell(40.0, (30.0, 52.0), 80, 20, ("scene1", "scene2")),
    Cell(12.3456, (10.0, 15.0), 40, 10, ("scene1",)),
)


def row(block: tuple[str, str], label: str, *cells: Cell, **more) -> Row:
    return Row(*block, label, label, "ADT", (True, False), cells, variant="full", **more)


def layout(*rows: Row, times: int = 1) -> Layout:
    scenes = ("scene1", "scene2", "x")
    notes = (Note("Odd & strange_one.", mark="a"), Note("Another."))
    texts = ("ablation", "A caption.", "adt", scenes)
    return Layout(*texts, COLUMNS * times, HEADINGS * times, {}, ("One", "Two"), rows, notes)


@pytest.fixture
def table() -> Layout:
    return layout(
        row(PAPER, "LERF", Cell(67.5), Cell(0.0), marks=("a", "")),
        row(PAPER, "GAGS", Cell(50.0), Cell(9.96)),
        row(OTHER, HOSTILE, *CELLS),
        row(OTHER, "none", Cell(), Cell()),
    )


def test_html_is_self_contained_and_shows_hostile_names_as_text(table):
    page = write_page([table], [], [])
    assert not re.search(r"<(script|img|link|iframe)|<[^>]* (src|href|on\w+)=", page)
    assert html.escape(HOSTILE, quote=True).replace("&#x27;", "'") in page.replace("&#34;", "&quot;")
    assert "default-src 'none'" in page


def test_html_has_a_row_a_line_with_its_interval_and_colors(table):
    text = to_html(table)
    rows = re.findall(r"<tr>(.*?)</tr>", text[text.index("<tbody>") :], re.DOTALL)
    assert len(rows) == 6 and {one.count("<td") for one in rows} == {5}
    assert "40.0\n30.0–52.0" in text and "80 queries of 20 categories" in text
    styles = dict(re.findall(r"#T_ablation_([^ ]+) {([^}]+)}", text.replace(", #T", " {} #T")))
    assert "#c00000" in text and "#007070" in text and "row0_col3" not in styles
    assert "#T_ablation_row5_col4" in text and "#T_ablation_row1_col0" not in text, "synthetic rows"


def test_csv_holds_every_number_of_a_cell(table):
    found = pd.read_csv(io.StringIO(to_csv(table)))
    assert len(found) == 8 and list(found["kind"].unique()) == ["printed", "synthetic"]
    first = found[found.method == HOSTILE].iloc[0]
    assert (first.percent, first.low, first.high) == (40.0, 30.0, 52.0)
    assert (first.queries, first.categories) == (80, 20)
    assert (first.scenes, first.steps, first.data) == ("scene1 scene2", "One", "ADT")
    assert found[found.method == "none"].percent.isna().all()
    assert found.percent.dropna().tolist() == [67.5, 0.0, 50.0, 9.96, 40.0, 12.346]


def test_csv_holds_no_formulas():
    names = ["=1+1", "+a", "-a", "@a"]
    text = to_csv(layout(*(row(("real", "b"), name, Cell(), Cell()) for name in names)))
    assert pd.read_csv(io.StringIO(text)).method.unique().tolist() == [f"'{name}" for name in names]
