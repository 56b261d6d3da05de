"""The messages of the stages that failed, as the last lines of a run."""

import atexit
import re
import sys
from collections.abc import Iterable
from pathlib import Path

_MESSAGE = "egosplat: "

# How Snakemake's log file names output and log of a failed job.
_FAILED = re.compile(r"^ +output: (.+)\n +log: (.+) \(check log file", re.MULTILINE)

# Largest number of messages that are repeated.
MOST = 10


def tell_failures_at_exit(logs: Iterable[str]) -> None:
    """Print the messages of failed stages at the end of the process, after Snakemake's own.

    Args:
        logs: paths of Snakemake's log files of this run.
    """
    lines = [line for log in logs for line in failures(Path(log))]
    atexit.register(lambda: [print(line, file=sys.stderr) for line in lines])


def failures(log: Path) -> list[str]:
    """A line for each stage that failed, with its last message."""
    failed = list(dict.fromkeys(_FAILED.findall(log.read_text(encoding="utf-8", errors="replace"))))
    lines = [f"{_MESSAGE}{output} was not made. {last_message(Path(own))}" for output, own in failed[:MOST]]
    more = len(failed) - MOST
    return [*lines, f"{_MESSAGE}{more} more were not made; see above"] if more > 0 else lines


def last_message(log: Path) -> str:
    """Get the last message of a stage from its log, or a pointer to the log if it has none."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        text = ""
    _, found, message = f"\n{text}".rpartition(f"\n{_MESSAGE}")
    return message if found else f"See {log}"
