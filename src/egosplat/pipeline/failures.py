"""What a run that failed says last: the message of each stage that failed, not the shell command that called it."""

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
_SHELL_FAILED = "CalledProcessError"
"""In Snakemake's account of a shell command that failed, which it gives beside that of the job."""

MOST = 10
"""So many messages are repeated."""


class ShortErrors(logging.Formatter):
    """Snakemake's own formatter without shell commands of jobs that failed; it keeps which jobs these were.

    Attributes:
        failed: the log file of each job that failed, by its first output.
    """

    def __init__(self, full: logging.Formatter) -> None:
        super().__init__()
        self._full = full
        self.failed: dict[str, str] = {}

    def format(self, record: logging.LogRecord) -> str:
        """The text of a record; empty for one that is left out."""
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
        """Have the messages of the jobs that failed printed when the process ends, after all that Snakemake says."""
        atexit.register(self._tell)

    def _tell(self) -> None:
        for output, log in list(self.failed.items())[:MOST]:
            print(f"{_MESSAGE}{output} was not made. {last_message(Path(log))}", file=sys.stderr)
        if len(self.failed) > MOST:
            print(f"{_MESSAGE}{len(self.failed) - MOST} more were not made; see above", file=sys.stderr)


def shorten_errors(handlers: Iterable[logging.Handler]) -> ShortErrors | None:
    """Leave shell commands out of what Snakemake says on the terminal; its log file keeps them.

    Args:
        handlers: of Snakemake's logger.

    Returns:
        The formatter; None where something else than Snakemake's own writes on the terminal.
    """
    for handler in handlers:
        if handler.name == "DefaultStreamHandler" and isinstance(handler.formatter, DefaultFormatter):
            short = ShortErrors(handler.formatter)
            handler.setFormatter(short)
            return short
    return None


def last_message(log: Path) -> str:
    """The message that a stage ended with, by its log; where it has none, the log's name."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        text = ""
    _, found, message = f"\n{text}".rpartition(f"\n{_MESSAGE}")
    return message if found else f"See {log}"
