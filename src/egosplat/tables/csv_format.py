"""Write a table as CSV, one line per number."""

from collections.abc import Iterator
from typing import Any

import pandas as pd

from egosplat.output_files import text_kind
from egosplat.tables.table import Block, Cell, Column, Row, Table

DECIMALS = 3

CSV = text_kind("egosplat tables", ".csv", begin="table,kind,method,")


def to_csv(table: Table) -> str:
    """Write one line per number; unknown values are empty.

    Columns: ``kind`` is ``printed``, ``real`` or ``synthetic``; ``percent``, ``low`` and ``high`` are a score and its
    interval [%]; ``queries`` and ``categories`` are their numbers; ``scenes`` are the scenes of a measured average;
    ``steps`` are the enabled components of an ablation.
    """
    lines = [
        _line(table, block, row, column, cell)
        for block in table.blocks
        for row in block.rows
        for column, cell in zip(table.columns, row.cells, strict=True)
    ]
    return pd.DataFrame(lines).astype({"queries": "Int64", "categories": "Int64"}).to_csv(index=False)


def _line(table: Table, block: Block, row: Row, column: Column, cell: Cell) -> dict[str, Any]:
    low, high = cell.interval or (None, None)
    return {
        "table": table.name,
        "kind": block.kind,
        "method": _harmless(row.method),
        "data": row.data,
        "checkpoints": _harmless(row.checkpoints),
        "variant": row.variant,
        "notice": row.notice,
        "steps": "; ".join(_steps(table, row)),
        "scene": column.scene,
        "metric": column.metric,
        "group": column.group,
        "percent": _rounded(cell.percent),
        "low": _rounded(low),
        "high": _rounded(high),
        "queries": cell.queries,
        "categories": cell.categories,
        "scenes": " ".join(cell.scenes),
    }


def _steps(table: Table, row: Row) -> Iterator[str]:
    return (name for name, used in zip(table.components, row.steps, strict=True) if used)


def _rounded(percent: float | None) -> float | None:
    return None if percent is None else round(percent, DECIMALS)


def _harmless(text: str) -> str:
    """Quote a name that a spreadsheet would read as a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text
