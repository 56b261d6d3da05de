"""Check that every score on a page is that of its rows: ``python -m benchmarks.quotes``; ``--write`` writes those of the rows.

A page quotes a figure or a table between two comments, ``<!--= SOURCE FIGURE SETTING -->77 % (68 to 85)<!--/-->``. SOURCE is a text
of the ledger, or a topic of benchmarks with rows; ``benchmarks/figures.py`` has the figures. A score without them is a fault, but
for those of ``TO_BE_MADE_ANEW``.
"""

import functools
import re
from collections.abc import Iterator
from pathlib import Path

import click

from benchmarks.common import ROOT, command
from benchmarks.figures import compute
from benchmarks.rows import Rows, read_source
from egosplat.errors import UserError

# Lines with scores that are older than rows, by page; to be made anew. A page may only lose some.
TO_BE_MADE_ANEW = {
    "benchmarks/README.md": 1,
    "benchmarks/instances/README.md": 3,
    "benchmarks/methods/README.md": 12,
    "benchmarks/open_vocabulary/README.md": 4,
    "benchmarks/real_camera/README.md": 2,
    "benchmarks/required/README.md": 5,
    "benchmarks/tradeoff/README.md": 2,
    "benchmarks/true_instances/README.md": 4,
    "benchmarks/tum_office/README.md": 2,
    "benchmarks/variants/README.md": 1,
}

# Code on a page is no quote.
CODE = re.compile(r"`[^`\n]+`")

QUOTE = re.compile(r"(?<!`)<!--= (?P<words>[^>]+?) -->(?P<told>.*?)<!--/-->", re.DOTALL)

# A score with its interval, a mIoU, or a share of queries that are found.
SCORE = re.compile(
    r"\d(?: %| dB| points[^()|;]{0,20})? \([+-]?\d+(?:\.\d+)? to [+-]?\d+(?:\.\d+)?(?:\)|, )"
    r"|mIoU(?: of)? 0\.\d\d"
    r"|\bfinds? \d+(?:\.\d)?(?: and \d+(?:\.\d)?)? %"
    r"|\d % found"
)


def pages(root: Path = ROOT) -> list[Path]:
    """The pages that may quote scores."""
    found = [*root.glob("*.md"), *(root / "config").glob("*.md"), *(root / "docs").glob("*.md")]
    return sorted({*found, *(root / "training").rglob("*.md"), *(root / "benchmarks").rglob("*.md")})


def quoted(text: str) -> str:
    """A page with the figures of its rows.

    Raises:
        UserError: a quote names no rows, setting or figure.
    """
    return QUOTE.sub(lambda quote: _filled(quote["words"]), text)


def faults(path: Path, root: Path = ROOT) -> Iterator[str]:
    """What is wrong with the scores of a page, a line each."""
    text, name = path.read_text(encoding="utf-8"), path.relative_to(root).as_posix()
    for quote in QUOTE.finditer(text):
        try:
            right = _filled(quote["words"])
        except UserError as error:
            yield f"{name}: {quote['words']}: {error}"
            continue
        if right != quote[0]:
            yield f"{name}: {quote['words']}: has {quote['told'].strip()!r}, its rows say otherwise"
    bare = unquoted(text)
    if len(bare) > TO_BE_MADE_ANEW.get(name, 0):
        yield f"{name}: {len(bare)} lines have scores without rows, the last {bare[-1][:80]!r}"


def unquoted(text: str) -> list[str]:
    """The lines of a page with scores that are not quoted."""
    return [line for line in CODE.sub("", QUOTE.sub("", text)).splitlines() if SCORE.search(line)]


def _filled(words: str) -> str:
    source, *rest = words.split()
    told = compute(_rows(source), rest)
    around = "\n" if "\n" in told else ""
    return f"<!--= {words} -->{around}{told}{around}<!--/-->"


@functools.cache
def _rows(source: str) -> Rows:
    return read_source(source)


@command(__doc__)
@click.option("--write", is_flag=True, help="Write the figures of the rows into the pages.")
def main(write: bool) -> None:
    """Check all pages, or write them."""
    if write:
        for path in pages():
            text = path.read_text(encoding="utf-8")
            if (right := quoted(text)) != text:
                path.write_text(right, encoding="utf-8")
    if wrong := [fault for path in pages() for fault in faults(path)]:
        raise UserError("\n".join(wrong))


if __name__ == "__main__":
    main()
