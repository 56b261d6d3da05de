"""Check every figure of the pages: ``python -m benchmarks.quotes``. ``--write`` fills quotes, ``--date`` dates blocks.

A figure is quoted from rows, ``<!--= SOURCE FIGURE SETTING -->77 % (68 to 85)<!--/-->``, where SOURCE is a text of the ledger or a
topic of benchmarks with rows, and ``benchmarks/figures.py`` has the figures. Or it stands in a dated block,
``<!--~2026-11-28.d68c81e0.1f2e3d4c-->a run takes 49 s<!--/~-->``, between date, commit and digest of its text, in which quotes count
by their words. Outside of both, every number on a page of measurements is a fault, but for names (SAM2) and code. Elsewhere numbers
of scores and of CPU time are. Not seen: fractions in words, code with a letter, pictures, and a digest made for a changed text.
"""

import functools
import hashlib
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click

from benchmarks.common import ROOT, command
from benchmarks.figures import compute
from benchmarks.rows import LEDGER, POOL, read_source
from egosplat.errors import UserError

# Pages that commands write, and pages of measurements beside those of benchmarks.
GENERATED = ("config/reference.md", "docs/numerics.md")
MEASURED = ("README.md", "docs/alarms.md", "docs/rasterizer.md", "docs/reliability.md", "docs/speed.md")

# Rows of README's scores, and what pages quote whatever else they say: neither better rows nor fewer figures.
HEADLINE = POOL
SCORES = (
    *("accuracy full", "accuracy draft", "accuracy occam", "accuracy_difference no_sizes occam"),
    *("mean_iou full", "mean_iou draft", "mean_iou occam", "mean_iou_difference no_sizes occam"),
    "psnr full static",
)
REQUIRED = {"README.md": [f"{HEADLINE} {score}" for score in SCORES]}
REQUIRED["benchmarks/presence/README.md"] = ["presence fit", "0.3.0 presence full right"]

QUOTE = re.compile(r"(?<!`)<!--= (?P<words>[^>]+?) -->(?P<told>.*?)<!--/-->", re.DOTALL)

BLOCK = re.compile(
    r"(?<!`)<!--~(?:(?P<date>\d{4}-\d\d-\d\d)\.(?P<commit>[0-9a-f]{8})\.(?P<digest>[0-9a-f]{8}))?-->"
    r"(?P<text>.*?)<!--/~-->(?!`)",
    re.DOTALL,
)

# What a page does not say, if it has a letter; and what it says that is no measurement.
HIDDEN = re.compile(r"```.*?```|`[^`\n]+`|\]\([^)]*\)|<a id=[^>]*>", re.DOTALL)
NAMES = re.compile(r"[A-Za-z_]+-?\d[\w.]*|[234]D|Python 3\.\d+(?: (?:or|to) 3\.\d+)?|95 % intervals?")

# A number, a score in words, and half of a marker; and on pages that measure nothing, a number of scores or of time.
NUMBER = re.compile(
    r"\d|<!--[=~/]|\b(?:one|two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|hundred|\w+(?:teen|ty))"
    r" (?:per ?cent|percentage|points|decibels|dB)",
    re.IGNORECASE,
)
SCORE = re.compile(
    r"<!--[=~/]|\d ?(?:dB|points|per ?cent|CPU-)|\d ?% (?:found|right|of (?:the |all )?(?:queries|things|places))"
    r"|\d of \d|mIoU(?: of)? \d|\bfinds? \d|\d(?: ?%)? \([+-]?\d+(?:\.\d+)? to [+-]?\d"
)


def pages(root: Path = ROOT) -> list[Path]:
    """The pages whose figures are checked."""
    found = [*root.glob("*.md"), *(root / "config").glob("*.md"), *(root / "docs").glob("*.md")]
    found += [path for folder in ("src", "training", "benchmarks") for path in (root / folder).rglob("*.md")]
    return sorted({*found} - {root / name for name in GENERATED})


def quoted(text: str) -> str:
    """A page with the figures of its rows.

    Raises:
        UserError: a quote names no rows, setting or figure.
    """
    return QUOTE.sub(lambda quote: _filled(quote["words"]), text)


def dated(text: str, commit: str) -> str:
    """A page whose new and changed blocks are of a commit; the others stay.

    Raises:
        UserError: it is not before this one.
    """
    date = (history() or {}).get(commit[:8])
    if date is None:
        raise UserError(f"{commit}: is no commit of this history; give eight digits of one")
    return BLOCK.sub(
        lambda block: block[0] if _is_whole(block) else _stamped(date, commit[:8], block["text"]), text
    )


def faults(path: Path, root: Path = ROOT) -> Iterator[str]:
    """What is wrong with the figures of a page, a line each."""
    text, name = path.read_text(encoding="utf-8"), path.relative_to(root).as_posix()
    for quote in QUOTE.finditer(text):
        try:
            right = _filled(quote["words"])
        except UserError as error:
            yield f"{name}: {quote['words']}: {error}"
            continue
        if right != quote[0]:
            yield f"{name}: {quote['words']}: has {quote['told'].strip()!r}, its rows say otherwise"
    yield from (
        f"{name}: {fault}" for fault in _choice(name, [quote["words"] for quote in QUOTE.finditer(text)])
    )
    for block in BLOCK.finditer(text):
        if not _is_whole(block):
            told = f"{name}: {' '.join(block['text'].split())[:60]!r}: was changed. With the commit of its figures:"
            yield f"{told} python -m benchmarks.quotes --date {block['commit'] or 'COMMIT'} {name}"
        elif (known := history()) is not None and known.get(block["commit"]) != block["date"]:
            yield f"{name}: {block['commit']}: this history has no such commit of {block['date']}"
    yield from (f"{name}: {line[:80]!r}: a figure without rows or date" for line in bare(text, name))


def bare(text: str, name: str) -> list[str]:
    """The lines of a page with figures that are neither quoted nor dated."""
    left = BLOCK.sub("", QUOTE.sub("", text))
    left = HIDDEN.sub(lambda hidden: " " if re.search("[A-Za-z]", hidden[0]) else hidden[0], left)
    if name.startswith("benchmarks/") or name in MEASURED or name.endswith("MODEL_CARD.md"):
        return [line for line in left.splitlines() if NUMBER.search(NAMES.sub("", line))]
    return [line for line in left.splitlines() if SCORE.search(line)]


def _choice(name: str, words: list[str]) -> Iterator[str]:
    """What is wrong with the choice of quotes."""
    yield from (f"{one}: is not quoted" for one in REQUIRED.get(name, ()) if one not in words)
    texts = [one for one in words if (LEDGER / one.split()[0]).is_dir() and one.split()[0] != HEADLINE]
    yield from (f"{one}: quote {HEADLINE}, no text of one's choice" for one in texts if name == "README.md")


@functools.cache
def history() -> dict[str, str] | None:
    """The date of each commit before this one, by its first eight digits; None where not all of them are known."""
    if not (ROOT / ".git").exists() or git("rev-parse", "--is-shallow-repository") != "false\n":
        return None
    return {line[:8]: line[41:] for line in git("log", "--format=%H %cs").splitlines()}


def git(*words: str) -> str:
    """What git says in the repository; nothing where it fails."""
    run = subprocess.run(["git", "-C", str(ROOT), *words], check=False, capture_output=True, text=True)
    return run.stdout if run.returncode == 0 else ""


def _is_whole(block: re.Match[str]) -> bool:
    return block[0] == _stamped(block["date"], block["commit"], block["text"])


def _stamped(date: str, commit: str, text: str) -> str:
    said = " ".join(QUOTE.sub(lambda quote: quote["words"], text).split())
    digest = hashlib.sha256(f"{date} {commit} {said}".encode()).hexdigest()
    return f"<!--~{date}.{commit}.{digest[:8]}-->{text}<!--/~-->"


_rows = functools.cache(read_source)


@functools.cache
def _filled(words: str) -> str:
    source, *rest = words.split()
    told = compute(_rows(source), rest)
    around = "\n" if "\n" in told else ""
    return f"<!--= {words} -->{around}{told}{around}<!--/-->"


@command(__doc__)
@click.option("--write", is_flag=True, help="Write the figures of the rows into the pages.")
@click.option("--date", nargs=2, metavar="COMMIT PAGE", help="Date the new and changed blocks of a page.")
def main(write: bool, date: tuple[str, str] | None) -> None:
    """Check all pages, or write them."""
    if date is not None:
        page = Path(date[1])
        page.write_text(dated(page.read_text(encoding="utf-8"), date[0]), encoding="utf-8")
    if write:
        for path in pages():
            text = path.read_text(encoding="utf-8")
            if (right := quoted(text)) != text:
                path.write_text(right, encoding="utf-8")
    if wrong := [fault for path in pages() for fault in faults(path)]:
        raise UserError("\n".join(wrong))


if __name__ == "__main__":
    main()
