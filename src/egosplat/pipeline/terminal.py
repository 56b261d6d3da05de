"""Plain words on the terminal: a line for each step of a run, and the message of each failed stage at the end."""

import atexit
import copy
import logging
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.common import LogEvent

_MESSAGE = "egosplat: "
# Text of Snakemake's second report of a failed shell command; the first is that of the job.
_SHELL_FAILED = "CalledProcessError"

# Largest number of messages that are repeated.
MOST = 10

# Lines of Snakemake about itself. Its log file keeps them.
_ABOUT_ITSELF = (
    *("Assuming unrestricted shared filesystem", "host: ", "Building DAG of jobs", "Using shell: "),
    *(
        "Select jobs to execute",
        "Execute ",
        "Updating checkpoint dependencies",
        "DAG of jobs will be updated",
    ),
    *("Group jobs: inactive", "Removing output files of failed job"),
)
_EVENTS_ABOUT_ITSELF = (
    *(LogEvent.WORKFLOW_STARTED, LogEvent.RESOURCES_INFO, LogEvent.JOB_STARTED, LogEvent.SHELLCMD),
    LogEvent.JOB_FINISHED,
)

# Expected seconds of finished steps from which on the speed of this machine corrects what is expected of the others.
_ENOUGH_S = 20.0


class Step(NamedTuple):
    """A job of the workflow: its rule, and name and value of each wildcard."""

    rule: str
    wildcards: frozenset[tuple[str, str]]

    @classmethod
    def of(cls, rule: str, wildcards: Mapping[str, str]) -> "Step":
        """The job of a rule with these wildcards."""
        return cls(rule, frozenset(wildcards.items()))


class StepTimes:
    """Steps of a run, and an estimate of the time that is left.

    Args:
        expected: the expected time of a step [s], or None if it is not known.
        planned: the steps of the run.
    """

    def __init__(
        self,
        expected: Callable[[Step], float | None],
        planned: Callable[[], Iterable[Step]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._expected, self._planned, self._clock = expected, planned, clock
        self._start = clock()
        self._to_do: set[Step] = set()
        self._begun: dict[int, Step] = {}
        self._done_s = 0.0
        self.total = 0

    def plan(self) -> None:
        """Set the steps of the run."""
        self._to_do = set(self._planned())
        self.total = len(self._to_do)

    def begin(self, job: int, step: Step) -> int:
        """Record the start of a job, and return its number from 1."""
        self._begun[job] = step
        # Steps that a decision of the survey adds were not planned.
        self.total = max(self.total, len(self._begun))
        return len(self._begun)

    def finish(self, job: int) -> None:
        """Record the end of a job."""
        if (step := self._begun.get(job)) is not None:
            self._to_do.discard(step)
            self._done_s += self._expected(step) or 0.0

    def left_s(self) -> float | None:
        """Expected time of the steps that are not done [s]; None if that of one is not known."""
        times = [self._expected(step) for step in self._to_do]
        if None in times:
            return None
        left = sum(times)
        pace = (self._clock() - self._start) / self._done_s if self._done_s >= _ENOUGH_S else 1.0
        return left * pace


class PlainOutput(logging.Formatter):
    """A line for each job in place of Snakemake's blocks, and no shell commands of failed jobs.

    Attributes:
        failed: the log file of each job that failed, by its first output.
        times: of the run's steps; None shows Snakemake's own blocks, as in a dry run.
    """

    def __init__(self, full: logging.Formatter) -> None:
        super().__init__()
        self._full = full
        self.failed: dict[str, str] = {}
        self.times: StepTimes | None = None

    def format(self, record: logging.LogRecord) -> str:
        """Format a record; empty for one that is left out."""
        event = getattr(record, "event", None)
        if event == LogEvent.JOB_ERROR:
            self._keep(record.__dict__)
            record = copy.copy(record)
            record.shellcmd, record.msg = None, ""
        elif event == LogEvent.ERROR and _SHELL_FAILED in str(record.msg):
            return ""
        elif self.times is not None and (line := self._line(event, record.__dict__, self.times)) is not None:
            return line
        return self._full.format(record)

    def _line(self, event: LogEvent | None, record: dict[str, Any], times: StepTimes) -> str | None:
        """The line in place of a record; None for Snakemake's own text."""
        if event == LogEvent.RUN_INFO:
            times.plan()
            return f"{times.total} steps{_left(times)}"
        if event == LogEvent.JOB_INFO:
            number = times.begin(record["jobid"], Step.of(record["rule_name"], record["wildcards"]))
            made = record["output"][0] if record["output"] else record["rule_name"]
            return f"[{number}/{times.total}] {record['rule_name']}: {made}{_left(times)}"
        if event == LogEvent.JOB_FINISHED:
            times.finish(record["job_id"])
        if event == LogEvent.PROGRESS:
            times.total = record["total"]
            # Snakemake's last line tells that all is done.
            return None if record["done"] == record["total"] else ""
        about_itself = event is None and str(record["msg"]).startswith(_ABOUT_ITSELF)
        return "" if event in _EVENTS_ABOUT_ITSELF or about_itself else None

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


def _left(times: StepTimes) -> str:
    left = times.left_s()
    if left is None:
        return ""
    return f", about {left:.0f} s left" if left < 90 else f", about {left / 60:.0f} min left"


def speak_plainly(handlers: Iterable[logging.Handler]) -> PlainOutput | None:
    """Shorten Snakemake's terminal output. Its log file keeps everything.

    Args:
        handlers: of Snakemake's logger.

    Returns:
        The formatter; None if another logger than Snakemake's writes to the terminal.
    """
    for handler in handlers:
        if handler.name == "DefaultStreamHandler" and isinstance(handler.formatter, DefaultFormatter):
            plain = PlainOutput(handler.formatter)
            handler.setFormatter(plain)
            return plain
    return None


def last_message(log: Path) -> str:
    """Get the last message of a stage from its log, or a pointer to the log if it has none."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        text = ""
    _, found, message = f"\n{text}".rpartition(f"\n{_MESSAGE}")
    return message if found else f"See {log}"
