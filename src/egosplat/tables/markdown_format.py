"""Write a table as GitHub Markdown, one Markdown table per block."""

import re
from collections.abc import Iterator

from egosplat.output_files import text_kind
from egosplat.tables.table import Block, Cell, Row, Table, aside, number

MARK = "<!-- egosplat tables -->"
"""First line of each file, a comment."""

MARKDOWN = text_kind("egosplat tables", ".md", begin=MARK)

ROOM = 8
"""Maximum number of columns of a table that also shows intervals."""

_SPECIAL = re.compile(r"([\\`*_{}\[\]|~$#])")
_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})
_RANKS = {0: "{}", 1: "**{}**", 2: "*{}*"}


def to_markdown(table: Table) -> str:
    """Write a table with caption and notes.

    The best number of a block is bold, the second best italic; synthetic blocks are not ranked.
    """
    parts = [MARK, f"### {escape(table.caption)}"]
    for block in table.blocks:
        parts += [f"**{escape(block.title)}**", "\n".join(_lines(table, block))]
    notes = [f"- {_mark(note.mark)} {escape(note.text)}".replace("-  ", "- ") for note in table.notes]
    return "\n\n".join([*parts, "\n".join(notes)]).strip() + "\n"


def escape(text: str) -> str:
    """Escape the special characters of Markdown, also inside a table."""
    return _SPECIAL.sub(r"\\\1", text.translate(_ENTITIES))


def _lines(table: Table, block: Block) -> Iterator[str]:
    columns = [" ".join(filter(None, (column.over, column.heading))) for column in table.columns]
    yield _line([*map(escape, table.components), "Method", *map(escape, columns)])
    yield _line([":-:"] * len(table.components) + ["---"] + ["--:"] * len(columns))
    for row in block.rows:
        ticks = ["✓" if used else "" for used in row.steps]
        cells = (_shown(cell, row, len(columns) <= ROOM) for cell in row.cells)
        yield _line([*ticks, escape(table.label(row)), *cells])


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _shown(cell: Cell, row: Row, room: bool) -> str:
    text = _RANKS[cell.rank].format(number(cell.percent))
    if room and cell.interval:
        text += f" ({number(cell.interval[0])}–{number(cell.interval[1])})"
    return text + aside(cell, row) + _mark(cell.mark)


def _mark(mark: str) -> str:
    return f"<sup>{mark}</sup>" if mark else ""
