"""Write a table as LaTeX, in the layout of the paper."""

from collections.abc import Iterator

from egosplat.output_files import text_kind
from egosplat.tables.table import Block, Cell, Row, Table, aside, number

MARK = "% egosplat tables"
"""First line of each file, a comment."""

LATEX = text_kind("egosplat tables", ".tex", begin=MARK)

WIDE = 8
"""Maximum number of columns of a table that fits one column of a page."""

_ESCAPED = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    **{one: f"\\{one}" for one in "{}$&#_%"},
}
_RANKS = {
    0: "{}",
    1: r"\textcolor[rgb]{{1,0,0}}{{\textbf{{{}}}}}",
    2: r"\textcolor[rgb]{{0,.502,.502}}{{\textbf{{{}}}}}",
}


def to_latex(table: Table) -> str:
    """Write a float with caption, notes and label ``tab:NAME``.

    The best number of a block is red, the second best teal; synthetic blocks are not ranked.
    """
    environment = "table" if len(table.columns) <= WIDE else "table*"
    lines = [
        MARK,
        r"% needs \usepackage{amssymb,booktabs,graphicx,xcolor} and \usepackage[T1]{fontenc}",
        rf"\begin{{{environment}}}[htbp]",
        r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{escape(table.caption)}}}",
        r"\resizebox{\linewidth}{!}{%",
        rf"\begin{{tabular}}{{{_columns(table)}}}",
        r"\toprule",
        *_head(table),
        *(line for block in table.blocks for line in _block(table, block)),
        r"\bottomrule",
        r"\end{tabular}}",
        *(rf"\par\smallskip\raggedright {_mark(note.mark)}{escape(note.text)}" for note in table.notes),
        rf"\label{{tab:{table.name}}}",
        rf"\end{{{environment}}}",
    ]
    return "\n".join(lines) + "\n"


def escape(text: str) -> str:
    """Escape the special characters of LaTeX."""
    return "".join(_ESCAPED.get(one, one) for one in text)


def _columns(table: Table) -> str:
    spans = [count for _, count in table.spans()] or [len(table.columns)]
    return "c" * len(table.components) + "l|" + "|".join("c" * count for count in spans)


def _head(table: Table) -> Iterator[str]:
    before = len(table.components) + 1
    if spans := table.spans():
        headings = (rf"\multicolumn{{{count}}}{{c}}{{{escape(over)}}}" for over, count in spans)
        yield " & ".join([""] * (before - 1) + [" ", *headings]) + r" \\"
        yield rf"\cmidrule{{{before + 1}-{before + len(table.columns)}}}"
    names = [*table.components, "Method", *(column.heading for column in table.columns)]
    yield " & ".join(map(escape, names)) + r" \\"


def _block(table: Table, block: Block) -> Iterator[str]:
    width = len(table.components) + 1 + len(table.columns)
    yield r"\midrule"
    yield rf"\multicolumn{{{width}}}{{l}}{{\textit{{{escape(block.title)}}}}} \\"
    for row in block.rows:
        ticks = (r"\checkmark" if used else "" for used in row.steps)
        cells = (_shown(cell, row) for cell in row.cells)
        yield " & ".join([*ticks, escape(table.label(row)), *cells]) + r" \\"


def _shown(cell: Cell, row: Row) -> str:
    return _RANKS[cell.rank].format(number(cell.percent)) + aside(cell, row) + _mark(cell.mark)


def _mark(mark: str) -> str:
    return rf"\textsuperscript{{{mark}}}" if mark else ""
