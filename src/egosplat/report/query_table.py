"""Answers as a table of plain text."""

from collections.abc import Sequence


def answers_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out one line a row in aligned columns.

    Args:
        columns: their names, C of them.
        rows: of C cells; a row of fewer ends in a sentence that does not widen its column.
    """
    every = [columns, *rows]
    cells = [row if len(row) == len(columns) else row[:-1] for row in every]
    widths = [max(len(row[place]) for row in cells if place < len(row)) for place in range(len(columns))]
    lines = ("  ".join(map(str.ljust, row, [*widths[: len(row) - 1], 0])).rstrip() for row in every)
    return "\n".join(lines)
