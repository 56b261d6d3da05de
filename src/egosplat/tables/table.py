"""A table of results: columns, blocks of rows of one origin, cells with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

PRINTED, REAL, SYNTHETIC = "printed", "real", "synthetic"
"""Kinds of blocks: what the paper prints, and what was measured here, on recordings or on synthetic apartments."""

METRIC_NAMES = {"accuracy": "Acc", "mean_iou": "mIoU"}


@dataclass(frozen=True)
class Column:
    """What its cells tell.

    Attributes:
        scene: its name, or ``AVERAGE``.
        metric, group: see ``egosplat.tables.paper_numbers``.
        over: heading that it shares with its neighbours; empty for none.
        heading: its own.
    """

    scene: str
    metric: str
    group: str
    over: str
    heading: str


@dataclass(frozen=True)
class Cell:
    """A number; None where there is none.

    Attributes:
        percent: the score [%].
        interval: its bounds [%].
        queries, categories: that it was measured with; None of a printed number.
        scenes: that a measured average was made of; empty of anything else.
        mark: letter of the footnote about it, or empty.
        rank: 1 or 2 where it is the best or the second best of its block, else 0.
    """

    percent: float | None = None
    interval: tuple[float, float] | None = None
    queries: int | None = None
    categories: int | None = None
    scenes: tuple[str, ...] = ()
    mark: str = ""
    rank: int = 0


@dataclass(frozen=True)
class Row:
    """The numbers of one method, of the data that the label names.

    Attributes:
        label: method, data and checkpoints in words.
        method, data, checkpoints, variant: the same, each by itself.
        steps: of an ablation, which of its components are in use; else empty.
        cells: one a column.
        notice: that the models do not know what the data show, and what to do; else empty.
    """

    label: str
    method: str
    data: str
    checkpoints: str
    variant: str
    steps: tuple[bool, ...]
    cells: tuple[Cell, ...]
    notice: str = ""

    @property
    def scenes(self) -> tuple[str, ...]:
        """All scenes that any of its averages is made of."""
        return tuple(sorted({scene for cell in self.cells for scene in cell.scenes}))


@dataclass(frozen=True)
class Block:
    """Rows that may be compared with each other, and with no other row.

    Attributes:
        kind: ``PRINTED``, ``REAL`` or ``SYNTHETIC``.
        title: says what they are.
        rows: in order.
    """

    kind: str
    title: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Note:
    """What a reader has to know; ``mark`` is the letter of the cells that it is about, or empty."""

    mark: str
    text: str


@dataclass(frozen=True)
class Table:
    """One table of the paper.

    Attributes:
        name: of its files.
        caption: says what it shows.
        components: headings of the columns of ticks that an ablation begins with.
        columns: in the paper's order.
        blocks: printed, real, synthetic; those that have rows.
        notes: below it.
        scenes: that an average is over when none is missing.
    """

    name: str
    caption: str
    components: tuple[str, ...]
    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]
    notes: tuple[Note, ...]
    scenes: tuple[str, ...]

    def spans(self) -> list[tuple[str, int]]:
        """Shared headings in order, each with its number of columns; empty where there is none at all."""
        found: list[tuple[str, int]] = []
        for column in self.columns:
            if found and found[-1][0] == column.over:
                found[-1] = (column.over, found[-1][1] + 1)
            else:
                found.append((column.over, 1))
        return found if any(heading for heading, _ in found) else []

    def label(self, row: Row) -> str:
        """A row's label; of a measured average with the number of its scenes."""
        if not row.scenes:
            return row.label
        return f"{row.label}, average of {len(row.scenes)} of {len(self.scenes)} scenes"


def number(percent: float | None) -> str:
    """A number as the paper prints it: of one decimal, ``-`` where there is none."""
    return "-" if percent is None else f"{percent:.1f}"


def aside(cell: Cell, row: Row) -> str:
    """Of an average that is made of fewer scenes than others of its row: their number, else nothing."""
    return f" (of {len(cell.scenes)})" if cell.scenes and cell.scenes != row.scenes else ""


def ranked(rows: Sequence[Row]) -> tuple[Row, ...]:
    """The rows with the best and the second best number of each column marked; equal ones are equally good.

    A row alone is best of nothing, and averages over different scenes are not ranked.
    """
    if len(rows) < 2:
        return tuple(rows)
    columns = [_ranked(cells) for cells in zip(*(row.cells for row in rows), strict=True)]
    return tuple(
        replace(row, cells=cells) for row, cells in zip(rows, zip(*columns, strict=True), strict=True)
    )


def _ranked(cells: Sequence[Cell]) -> list[Cell]:
    there = [cell for cell in cells if cell.percent is not None]
    if len(there) < 2 or len({cell.scenes for cell in there}) > 1:
        return list(cells)
    best = sorted({number(cell.percent) for cell in there}, key=float, reverse=True)[:2]
    places = {shown: place for place, shown in enumerate(best, start=1)}
    return [replace(cell, rank=places.get(number(cell.percent), 0)) for cell in cells]
