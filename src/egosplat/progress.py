"""Report progress: a bar on a terminal, plain lines in a log file.

Lines go to the logger ``egosplat`` of Python's ``logging``. The command line shows them; a program that imports egosplat
decides itself.
"""

import logging
import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")

_LOGGER = logging.getLogger("egosplat")

_SECONDS_BETWEEN_LINES = 10.0

# Number of ranges listed in a message.
_MAX_RANGES = 12


class _StandardError(logging.Handler):
    """Writes each message as a line to what ``sys.stderr`` is at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)


def show_log() -> None:
    """Show log lines and progress on standard error, unless the program has given the logger a handler of its own."""
    if not _LOGGER.handlers:
        _LOGGER.addHandler(_StandardError())
        # A library that configures the root logger would show each line twice.
        _LOGGER.propagate = False
    _LOGGER.setLevel(logging.INFO)


def hush_log() -> None:
    """Show neither progress nor log lines but those for ``always``."""
    _LOGGER.setLevel(logging.WARNING)


def is_hushed() -> bool:
    """Whether ``hush_log`` was called."""
    return _LOGGER.level == logging.WARNING


def name_lines(step: str) -> None:
    """Begin each line that ``show_log`` shows with the name of a step of a run; steps that run at once share one screen."""
    for handler in _LOGGER.handlers:
        handler.setFormatter(logging.Formatter(f"{step}: %(message)s"))


def track(items: Iterable[Item], what: str, total: int | None = None, unit: str = "frame") -> Iterator[Item]:
    """Yield ``items`` and report progress, rate and remaining time of ``what``, a few words, by ``unit`` in the singular.

    A terminal gets a bar. A log file gets a line about every ten seconds and one at the end. ``total`` is their number, if
    ``items`` has no length.
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    # A redrawn bar would fill a log file with carriage returns.
    if sys.stderr.isatty() and _LOGGER.isEnabledFor(logging.INFO):
        yield from tqdm(items, desc=what, total=total, unit=unit, file=sys.stderr)
        return
    start = last = time.perf_counter()
    done = 0
    for item in items:
        yield item
        done += 1
        now = time.perf_counter()
        if now - last >= _SECONDS_BETWEEN_LINES and done != total:
            last = now
            log(_line(what, done, total, now - start, unit))
    log(_line(what, done, total, time.perf_counter() - start, unit))


def log(message: str, *, always: bool = False) -> None:
    """Log one line, ``always`` also where the log is hushed."""
    _LOGGER.log(logging.WARNING if always else logging.INFO, "%s", message)


def format_ranges(numbers: set[int]) -> str:
    """Sorted numbers with runs as ``3 to 7``; at most ``_MAX_RANGES`` runs."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    listed = [str(first) if first == last else f"{first} to {last}" for first, last in runs[:_MAX_RANGES]]
    return ", ".join([*listed, *(["..."] if len(runs) > _MAX_RANGES else [])])


def _line(what: str, done: int, total: int | None, seconds: float, unit: str) -> str:
    rate = done / seconds if seconds > 0 else 0.0
    speed = f"{seconds / done:.0f} s a {unit}" if 0 < rate < 0.1 else f"{rate:.1f} {unit}s/s"
    text = f"{what}: {done}" + (f"/{total}" if total is not None else "") + f" {unit}s, {speed}"
    if total is not None and 1 < done < total and rate > 0:  # the first item may wait for a program's start
        text += f", {(total - done) / rate:.0f} s left"
    return text
