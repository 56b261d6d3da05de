"""Report progress: a bar on a terminal, plain lines in a log file."""

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")

_SECONDS_BETWEEN_LINES = 10.0


def track(items: Iterable[Item], what: str, total: int | None = None, unit: str = "frame") -> Iterator[Item]:
    """Yield ``items`` and report progress, rate and remaining time.

    A terminal gets a bar. A log file gets a line about every ten seconds and one at the end.

    Args:
        items: to iterate over.
        what: the work in a few words, for example ``"reading frames"``.
        total: number of items, if ``items`` has no length.
        unit: name of one item, in the singular.
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    # A redrawn bar would fill a log file with carriage returns.
    if sys.stderr.isatty():
        yield from tqdm(items, desc=what, total=total, unit=unit, file=sys.stderr)
        return
    start = last = time.perf_counter()
    done = 0
    for item in items:
        yield item
        done += 1
        now = time.perf_counter()
        if now - last >= _SECONDS_BETWEEN_LINES:
            last = now
            log(_line(what, done, total, now - start, unit))
    log(_line(what, done, total, time.perf_counter() - start, unit))


def log(message: str) -> None:
    """Write one line to standard error and flush it."""
    print(message, file=sys.stderr, flush=True)


def _line(what: str, done: int, total: int | None, seconds: float, unit: str) -> str:
    rate = done / seconds if seconds > 0 else 0.0
    text = f"{what}: {done}" + (f"/{total}" if total is not None else "") + f" {unit}s, {rate:.1f} {unit}s/s"
    if total is not None and 0 < done < total and rate > 0:
        text += f", {(total - done) / rate:.0f} s left"
    return text
