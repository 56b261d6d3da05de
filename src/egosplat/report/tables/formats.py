"""Write a table as CSV, GitHub Markdown or LaTeX. Markdown and LaTeX are templates in this folder, as is the page."""

import re
from importlib import resources
from typing import Any

import pandas as pd
from jinja2 import Environment, StrictUndefined

from egosplat.report.tables.table import Block, Cell, Column, Row, Table, aside, number

COMMAND = "egosplat tables"
# First line of each file, a comment.
MARKDOWN_MARK, LATEX_MARK = f"<!-- {COMMAND} -->", f"% {COMMAND}"

# A table with more columns shows no intervals in Markdown, and fills both columns of a page in LaTeX.
MANY = 8

# Decimals of the numbers in CSV.
DECIMALS = 3

_DELIMITERS = [
    f"{kind}_{side}_string" for kind in ("variable", "block", "comment") for side in ("start", "end")
]

_MARKDOWN = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;"} | {one: f"\\{one}" for one in r"\`*_{}[]|~$#"}
)
_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': r"\textquotedbl{}",
    }
    | {one: f"\\{one}" for one in "{}$&#_%"}
)
_MARKDOWN_RANKS = ("%s", "**%s**", "*%s*")
# The best number is bold red, the second best bold teal.
_LATEX_RANKS = ("%s", r"\textcolor[rgb]{1,0,0}{\textbf{%s}}", r"\textcolor[rgb]{0,.502,.502}{\textbf{%s}}")


def render(template: str, **values: Any) -> str:
    """Fill a template of this folder. The page's template escapes every value; the others have filters for it."""
    # LaTeX is full of braces.
    delimiters = dict(zip(_DELIMITERS, ("<<", ">>", "<%", "%>", "<#", "#>"), strict=True))
    environment = Environment(
        autoescape=".html" in template,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        **(delimiters if ".tex" in template else {}),
    )
    environment.filters |= {"markdown": markdown, "latex": latex}
    text = (resources.files(__package__) / template).read_text(encoding="utf-8")
    return environment.from_string(text).render(number=number, aside=aside, **values)


def markdown(text: str) -> str:
    """Escape the special characters of Markdown, also inside a table."""
    return text.translate(_MARKDOWN)


def latex(text: str) -> str:
    """Escape the special characters of LaTeX."""
    return text.translate(_LATEX)


def to_markdown(table: Table) -> str:
    """Write one Markdown table per block. The best number is bold, the second best italic."""
    headings = [" ".join(filter(None, (column.over, column.heading))) for column in table.columns]
    values = {"mark": MARKDOWN_MARK, "headings": headings, "many": MANY, "ranks": _MARKDOWN_RANKS}
    return render("tables.md.j2", table=table, **values).strip() + "\n"


def to_latex(table: Table) -> str:
    """Write a float with caption, notes and label ``tab:NAME``. The best number is red, the second best teal."""
    return render("tables.tex.j2", mark=LATEX_MARK, table=table, many=MANY, ranks=_LATEX_RANKS) + "\n"


def to_csv(table: Table) -> str:
    """Write one line per number; unknown values are empty.

    Columns: ``kind`` is ``printed``, ``real`` or ``synthetic``; ``percent``, ``low`` and ``high`` are a score and its
    interval [%]; ``queries`` and ``categories`` are their numbers; ``scenes`` are the scenes of a measured average;
    ``steps`` are the enabled components of an ablation; ``cpu_min`` and ``memory_gib`` are the row's cost of a scene;
    ``stands_in`` is what replaces parts of a method.
    """
    lines = pd.DataFrame(
        _csv_line(table, block, row, column, cell)
        for block in table.blocks
        for row in block.rows
        for column, cell in zip(table.columns, row.cells, strict=True)
    )
    lines = lines.astype({"queries": "Int64", "categories": "Int64"})
    floats = ("percent", "low", "high", "cpu_min", "memory_gib")
    return lines.astype(dict.fromkeys(floats, float)).round(DECIMALS).to_csv(index=False)


def _csv_line(table: Table, block: Block, row: Row, column: Column, cell: Cell) -> dict[str, Any]:
    low, high = cell.interval or (None, None)
    return {
        "table": table.name,
        "kind": block.kind,
        "method": _harmless(row.method),
        "data": row.data,
        "checkpoints": _harmless(row.checkpoints),
        "variant": row.variant,
        "notice": row.notice,
        "steps": "; ".join(name for name, used in zip(table.components, row.steps, strict=True) if used),
        "scene": column.scene,
        "metric": column.metric,
        "group": column.group,
        "percent": cell.percent,
        "low": low,
        "high": high,
        "queries": cell.queries,
        "categories": cell.categories,
        "scenes": " ".join(cell.scenes),
        "cpu_min": row.cost and row.cost.cpu_min,
        "memory_gib": row.cost and row.cost.memory_gib,
        "stands_in": "; ".join(row.stands_in),
    }


def _harmless(text: str) -> str:
    """Quote a name that a spreadsheet would read as a formula."""
    return f"'{text}" if re.match("[=+@-]", text) else text
