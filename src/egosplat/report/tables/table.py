"""Tables of results: columns, blocks of comparable rows, cells with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

# Kinds of blocks: printed in the paper, measured on recordings, measured on synthetic apartments.
PRINTED, REAL, SYNTHETIC = "printed", "real", "synthetic"

METRIC_NAMES = {"accuracy": "Acc", "mean_iou": "mIoU"}


@dataclass(frozen=True)
class Column:
    """A column.

    Attributes:
        scene: name of the scene, or ``AVERAGE``.
        metric, group: see ``egosplat.report.tables.paper_numbers``.
        over: heading shared with neighboring columns; empty for none.
        heading: heading of the column.
    """

    scene: str
    metric: str
    group: str
    over: str
    heading: str


@dataclass(frozen=True)
class Cell:
    """A number of a table.

    Attributes:
        percent: the score [%], or None.
        interval: bounds of its interval [%], or None.
        queries, categories: numbers of queries and categories; None for a printed number.
        scenes: scenes of a measured average; else empty.
        mark: letter of a footnote, or empty.
        rank: 1 for the best and 2 for the second best number of a block, else 0.
    """

    percent: float | None = None
    interval: tuple[float, float] | None = None
    queries: int | None = None
    categories: int | None = None
    scenes: tuple[str, ...] = ()
    mark: str = ""
    rank: int = 0


@dataclass(frozen=True)
class Cost:
    """CPU time of all threads [min] and the largest memory [GiB] that a scene takes, from its frames to its codes."""

    cpu_min: float
    memory_gib: float


@dataclass(frozen=True)
class Row:
    """The numbers of one method on one kind of data.

    Attributes:
        label: method, data and checkpoints, in one text.
        method, data, checkpoints, variant: parts of the label.
        steps: enabled components of an ablation; else empty.
        cells: one per column.
        notice: notice that the models do not suit the data, and what to do; else empty.
        cost: mean over its scenes; None for a printed row, or if it is not known.
        stands_in: sentences on what replaces a part of the method.
        mark: letters of its footnotes, or empty.
    """

    label: str
    method: str
    data: str
    checkpoints: str
    variant: str
    steps: tuple[bool, ...]
    cells: tuple[Cell, ...]
    notice: str = ""
    cost: Cost | None = None
    stands_in: tuple[str, ...] = ()
    mark: str = ""

    @property
    def scenes(self) -> tuple[str, ...]:
        """All scenes of its averages."""
        return tuple(sorted({scene for cell in self.cells for scene in cell.scenes}))


@dataclass(frozen=True)
class Block:
    """Rows that may be compared with each other, but not with other rows.

    Attributes:
        kind: ``PRINTED``, ``REAL`` or ``SYNTHETIC``.
    """

    kind: str
    title: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Note:
    """A footnote; ``mark`` is the letter of its cells, or empty."""

    mark: str
    text: str


@dataclass(frozen=True)
class Table:
    """One table of the paper.

    Attributes:
        name: stem of the files.
        components: headings of the first columns of an ablation, one per component.
        scenes: scenes of a complete average.
    """

    name: str
    caption: str
    components: tuple[str, ...]
    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]
    notes: tuple[Note, ...]
    scenes: tuple[str, ...]

    @property
    def has_costs(self) -> bool:
        """Whether any row has a cost."""
        return any(row.cost for block in self.blocks for row in block.rows)

    def spans(self) -> list[tuple[str, int]]:
        """Shared headings in order, each with its number of columns; empty without shared headings."""
        found = [(over, len([*columns])) for over, columns in groupby(column.over for column in self.columns)]
        return found if any(over for over, _ in found) else []

    def label(self, row: Row) -> str:
        """The label of a row, with the number of scenes of a measured average."""
        if not row.scenes:
            return row.label
        return f"{row.label}, average of {len(row.scenes)} of {len(self.scenes)} scenes"


def number(percent: float | None) -> str:
    """Format a number as in the paper, with one decimal; ``-`` for None."""
    return "-" if percent is None else f"{percent:.1f}"


def aside(cell: Cell, row: Row) -> str:
    """The number of scenes of an average over fewer scenes than others in its row; else empty."""
    return f" (of {len(cell.scenes)})" if cell.scenes and cell.scenes != row.scenes else ""


def ranked(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Rank the best and the second best number of each column; equal printed numbers have equal ranks.

    Single rows and averages over different scenes are not ranked.
    """
    if len(rows) < 2:
        return tuple(rows)
    columns = [_ranked(cells) for cells in zip(*(row.cells for row in rows), strict=True)]
    return tuple(
        replace(row, cells=cells) for row, cells in zip(rows, zip(*columns, strict=True), strict=True)
    )


def _ranked(cells: Sequence[Cell]) -> list[Cell]:
    known = [cell for cell in cells if cell.percent is not None]
    # Averages over different scenes cannot be compared.
    if len(known) < 2 or len({cell.scenes for cell in known}) > 1:
        return list(cells)
    # Compared as they are printed: equal texts must not have different ranks.
    best = sorted({number(cell.percent) for cell in known}, key=float, reverse=True)[:2]
    ranks = {text: rank for rank, text in enumerate(best, start=1)}
    return [replace(cell, rank=ranks.get(number(cell.percent), 0)) for cell in cells]
