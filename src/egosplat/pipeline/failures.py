"""Last lines of a failed run: the message of each failed stage instead of its shell command."""

import atexit
import copy
import logging
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.common import LogEvent

_MESSAGE = "egosplat: "
# Text of Snakemake's second report of a failed shell command; the first is that of the job.
_SHELL_FAILED = "CalledProcessError"

# Largest number of messages that are repeated.
MOST = 10


class ShortErrors(logging.Formatter):
    """Snakemake's own formatter without the shell commands of failed jobs. It collects these jobs.

    Attributes:
        failed: the log file of each job that failed, by its first output.
    """

    def __init__(self, full: logging.Formatter) -> None:
        super().__init__()
        self._full = full
        self.failed: dict[str, str] = {}

    def format(self, record: logging.LogRecord) -> str:
        """Format a record; empty for one that is left out."""
        event = getattr(record, "event", None)
        if event == LogEvent.JOB_ERROR:
            self._keep(record.__dict__)
            record = copy.copy(record)
            record.shellcmd, record.msg = None, ""
        elif event == LogEvent.ERROR and _SHELL_FAILED in str(record.msg):
            return ""
        return self._full.format(record)

    def _keep(self, job: dict[str, Any]) -> None:
        if job["output"] and job["log"]:
            self.failed[job["output"][0]] = job["log"][0]

    def tell_at_exit(self) -> None:
        """Print the messages of failed jobs at the end of the process, after Snakemake's own."""
        atexit.register(self._tell)

    def _tell(self) -> None:
        for output, log in list(self.failed.items())[:MOST]:
            print(f"{_MESSAGE}{output} was not made. {last_message(Path(log))}", file=sys.stderr)
        if len(self.failed) > MOST:
            print(f"{_MESSAGE}{len(self.failed) - MOST} more were not made; see above", file=sys.stderr)


def shorten_errors(handlers: Iterable[logging.Handler]) -> ShortErrors | None:
    """Leave shell commands out of Snakemake's terminal output. Its log file keeps them.

    Args:
        handlers: of Snakemake's logger.

    Returns:
        The formatter; None if another logger than Snakemake's writes to the terminal.
    """
    for handler in handlers:
        if handler.name == "DefaultStreamHandler" and isinstance(handler.formatter, DefaultFormatter):
            short = ShortErrors(handler.formatter)
            handler.setFormatter(short)
            return short
    return None


def last_message(log: Path) -> str:
    """Get the last message of a stage from its log, or a pointer to the log if it has none."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        text = ""
    _, found, message = f"\n{text}".rpartition(f"\n{_MESSAGE}")
    return message if found else f"See {log}"
