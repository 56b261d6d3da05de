"""Write a table as CSV or HTML."""

import re
from typing import Any

import pandas as pd
from pandas.io.formats.style import Styler

from egosplat_rivals.scored_scenes import Cell
from egosplat_rivals.tables.table import SYNTHETIC, Layout, Row, blocks, number, ranks

COMMAND = "egosplat-rivals tables"
# By rank: none, the best number, the second best one.
_STYLE_RANKS = ("", "font-weight: bold; color: #c00000", "font-weight: bold; color: #007070")
_LABEL = "text-align: left; white-space: normal; min-width: 19rem; font-size: .85rem"
_TITLE, _SYNTHETIC = "font-style: italic", "background-color: #fdf3dc"


def to_html(table: Layout) -> str:
    """Write a table element; below a measured number is its interval. Synthetic rows are yellow, the best numbers red and teal."""
    label, texts, lines = len(table.components), _texts(table), _lines(table)
    if not any(over for over, _ in texts.columns):
        texts.columns = texts.columns.droplevel(0)
    styles, tips = (pd.DataFrame("", texts.index, texts.columns) for _ in range(2))
    for line, (row, own) in enumerate(lines):
        if row is None:
            styles.iloc[line, label] = _TITLE
            continue
        for column, (cell, rank) in enumerate(zip(row.cells, own, strict=True), label + 1):
            styles.iloc[line, column] = _STYLE_RANKS[rank]
            if cell.queries is not None:
                tips.iloc[line, column] = f"{cell.queries} queries of {cell.categories} categories"
    style = Styler(texts, uuid=table.name, cell_ids=True).apply(lambda _: styles, axis=None)
    style.hide(axis="index").format(escape="html").format_index(escape="html", axis=1)
    synthetic = [row is not None and row.kind == SYNTHETIC for row, _ in lines]
    style.apply(lambda column: [_SYNTHETIC if one else "" for one in synthetic])
    left = {"selector": f".col{label}:not(.col_heading)", "props": _LABEL}
    style.set_table_styles([left], overwrite=False)
    return style.set_tooltips(tips).to_html()


def to_csv(table: Layout) -> str:
    """Write one line per number; unknown values are empty.

    Columns: ``kind`` is ``printed``, ``real`` or ``synthetic``; ``percent``, ``low`` and ``high`` are a score and its
    interval [%]; ``queries`` and ``categories`` are their numbers; ``scenes`` are the scenes of a measured average;
    ``readout`` is how a row is asked (``ScoredScene.readout``); ``steps`` are the enabled components of an ablation; ``cpu_min`` and ``memory_gib``
    are the row's cost of a scene; ``stands_in`` is what replaces parts of a method.
    """
    lines = pd.DataFrame(
        _csv_line(table, row, *pair)
        for row in table.rows
        for pair in zip(table.columns, row.cells, strict=True)
    )
    lines = lines.astype({"queries": "Int64", "categories": "Int64"})
    floats = ("percent", "low", "high", "cpu_min", "memory_gib")
    return lines.astype(dict.fromkeys(floats, float)).round(3).to_csv(index=False)


def _csv_line(table: Layout, row: Row, column: tuple[str, str, str], cell: Cell) -> dict[str, Any]:
    (low, high), (cpu_min, memory_gib) = cell.interval or (None, None), row.cost or (None, None)
    return {
        "table": table.name,
        "kind": row.kind,
        "method": _harmless(row.method),
        "data": row.data,
        "checkpoints": _harmless(row.checkpoints),
        "variant": row.variant,
        "readout": row.readout,
        "notice": row.notice,
        "steps": "; ".join(name for name, used in zip(table.components, row.steps, strict=True) if used),
        **dict(zip(("scene", "metric", "group"), column, strict=True)),
        "percent": cell.percent,
        "low": low,
        "high": high,
        "queries": cell.queries,
        "categories": cell.categories,
        "scenes": " ".join(cell.scenes),
        "cpu_min": cpu_min,
        "memory_gib": memory_gib,
        "stands_in": "; ".join(row.stands_in),
    }


def _harmless(text: str) -> str:
    """Quote a name that a spreadsheet would read as a formula."""
    return f"'{text}" if re.match("[=+@-]", text) else text


def _lines(table: Layout) -> list[tuple[Row | None, list[int]]]:
    """The rows with the ranks of their cells; None and no rank for the title above each block."""
    return [
        line for _, own in blocks(table.rows) for line in [(None, []), *zip(own, ranks(own), strict=True)]
    ]


def _texts(table: Layout) -> pd.DataFrame:
    """The table as texts, with a line for the title of each block."""
    costs = (("a scene", "CPU min"), ("a scene", "GiB")) if table.has_costs else ()
    numbers = (*table.headings, *costs)
    columns = [*(("", name) for name in table.components), ("", "Method"), *numbers]
    lines: list[list[str]] = []
    for title, own in blocks(table.rows):
        lines.append([*[""] * len(table.components), title, *[""] * len(numbers)])
        lines += [_text_line(table, row) for row in own]
    return pd.DataFrame(lines, columns=pd.MultiIndex.from_tuples(columns))


def _text_line(table: Layout, row: Row) -> list[str]:
    steps = ["✓" if used else "" for used in row.steps]
    marks = row.marks or ("",) * len(row.cells)
    cells = [
        number(cell.percent)
        + (f" (of {len(cell.scenes)})" if cell.scenes and cell.scenes != row.scenes else "")
        + (f" [{mark}]" if mark else "")
        + ("\n{}–{}".format(*map(number, cell.interval)) if cell.interval else "")
        for cell, mark in zip(row.cells, marks, strict=True)
    ]
    costs = [number(one) for one in row.cost or (None, None)] if table.has_costs else []
    return [*steps, table.label(row), *cells, *costs]
