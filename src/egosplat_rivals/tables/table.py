"""The tables of results: their layout, their rows and their notes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.scored_scenes import FULL, NO_SIZES, PIXELS, Cell

# Kinds of rows: printed in the paper, measured on recordings, measured on synthetic apartments. Name of the average in place
# of a scene.
PRINTED, REAL, SYNTHETIC, AVERAGE = "printed", "real", "synthetic", "average"


@dataclass(frozen=True)
class Note:
    """A footnote with its letter, on printed numbers by scene, method, metric and group, or without any on the whole table."""

    text: str
    cells: tuple[tuple[str, str, str, str], ...] = ()
    mark: str = ""

    def __str__(self) -> str:
        return f"[{self.mark}] {self.text}" if self.mark else self.text


@dataclass(frozen=True)
class Row:
    """The numbers of one method on one kind of data, a cell a column.

    Attributes:
        kind: ``PRINTED``, ``REAL`` or ``SYNTHETIC``.
        block: title of the rows that may be compared with this one.
        steps: enabled components of an ablation; else empty.
        marks, mark: letters of the footnotes of cells, one per column, empty if no cell has one; and of the row.
        notice: notice that the models do not suit the data, and what to do.
        cost: mean over its scenes of the CPU time of all threads [min] and of the largest memory [GiB], from the frames to
            the codes; None for a printed row, or if it is not known.
        stands_in: sentences on what replaces a part of the method.
        readout: how a measured row is asked, see ``ScoredScene.readout``.
    """

    kind: str
    block: str
    label: str
    method: str
    data: str
    steps: tuple[bool, ...]
    cells: tuple[Cell, ...]
    checkpoints: str = ""
    variant: str = ""
    marks: tuple[str, ...] = ()
    mark: str = ""
    notice: str = ""
    cost: tuple[float, float] | None = None
    stands_in: tuple[str, ...] = ()
    readout: str = ""

    @property
    def scenes(self) -> tuple[str, ...]:
        """All scenes of its averages."""
        return tuple(sorted({scene for cell in self.cells for scene in cell.scenes}))


@dataclass(frozen=True)
class Layout:
    """One table of the paper, without or with its rows.

    Attributes:
        name: stem of the files, and name of the table in the paper's numbers.
        scenes: those of a complete average.
        columns: scene (or ``AVERAGE``), metric and group of each column.
        headings: heading shared with neighboring columns (empty for none), and heading of each column.
        lines: variant of EgoSplat (None for another method) and enabled components of each of the paper's lines, by its name.
        components: headings of the components of an ablation.
    """

    name: str
    caption: str
    dataset: str
    scenes: tuple[str, ...]
    columns: tuple[tuple[str, str, str], ...]
    headings: tuple[tuple[str, str], ...]
    lines: Mapping[str, tuple[str | None, tuple[bool, ...]]]
    components: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def variants(self) -> dict[str, str]:
        """Line of each variant of EgoSplat that the table shows."""
        lines = {variant: line for line, (variant, _) in self.lines.items() if variant}
        return lines if self.components else lines | dict.fromkeys((PIXELS, NO_SIZES), lines[FULL])

    @property
    def has_costs(self) -> bool:
        return any(row.cost for row in self.rows)

    def label(self, row: Row) -> str:
        """The label of a row, with the number of scenes of a measured average and its footnotes."""
        average = f", average of {len(row.scenes)} of {len(self.scenes)} scenes" if row.scenes else ""
        return row.label + average + (f" [{row.mark}]" if row.mark else "")


def blocks(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Title and rows of each block."""
    for title, own in groupby(rows, key=lambda row: row.block):
        yield title, list(own)


def number(percent: float | None) -> str:
    """Format a number as in the paper, with one decimal; ``-`` for None."""
    return "-" if percent is None else f"{percent:.1f}"


def ranks(rows: Sequence[Row]) -> list[list[int]]:
    """The rank of each cell of a block: 1 for the best and 2 for the second best number of its column and read-out, else 0.

    Equal printed numbers have equal ranks. Synthetic rows are not ranked, because a mark on the best could be mistaken for the
    best of the table. Nor are rows of chance, single rows, and averages over different scenes, which cannot be compared.
    """
    found = [[0] * len(row.cells) for row in rows]
    ranked = [one for one in zip(rows, found, strict=True) if one[0].kind != SYNTHETIC]
    for readout in {row.readout for row in rows}:
        alike = [
            (row.cells, own)
            for row, own in ranked
            if row.readout == readout and row.method not in CHANCE.values()
        ]
        for column, cells in enumerate(zip(*(cells for cells, _ in alike), strict=True)):
            known = [cell for cell in cells if cell.percent is not None]
            if len(known) < 2 or len({cell.scenes for cell in known}) > 1:
                continue
            # Compared as they are printed: equal texts must not have different ranks.
            best = sorted({number(cell.percent) for cell in known}, key=float, reverse=True)[:2]
            for (_, own), cell in zip(alike, cells, strict=True):
                text = number(cell.percent)
                own[column] = best.index(text) + 1 if text in best else 0
    return found
