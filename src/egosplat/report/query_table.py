"""Answers as a table of plain text."""

from collections.abc import Sequence

from egosplat.query.answer import Answer

COLUMNS = ("query", "score", "level", "pixel", "position [m]")

_ABSENT = "-"


def answers_table(answers: Sequence[Answer], levels: Sequence[str]) -> str:
    """One line an answer, in aligned columns; ``-`` where nothing is seen.

    Args:
        answers: in order.
        levels: their names.
    """
    rows = [COLUMNS, *(_row(answer, levels) for answer in answers)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


def _row(answer: Answer, levels: Sequence[str]) -> tuple[str, ...]:
    pixel, position = answer.pixel, answer.position
    return (
        answer.phrase,
        f"{answer.score:.3f}",
        _ABSENT if answer.level is None else levels[answer.level],
        _ABSENT if pixel is None else f"{pixel[0]}, {pixel[1]}",
        _ABSENT if position is None else ", ".join(f"{one:.2f}" for one in position),
    )
