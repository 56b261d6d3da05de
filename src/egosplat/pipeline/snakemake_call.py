"""Targets and options of a Snakemake call, and the messages of its stages that failed."""

import atexit
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

_MESSAGE = "egosplat: "

# How Snakemake's log file names output and log of a failed job.
_FAILED = re.compile(r"^ +output: (.+)\n +log: (.+) \(check log file", re.MULTILINE)

# Largest number of messages that are repeated.
MOST = 10

# Options with which Snakemake makes no results, named as in its parser.
_MAKES_NOTHING = {
    *("d3dag", "dag", "detailed_summary", "dryrun", "filegraph", "lint", "list_changes", "list_conda_envs"),
    *(
        "list_input_changes",
        "list_params_changes",
        "list_rules",
        "list_target_rules",
        "list_untracked",
        "report",
    ),
    *("rulegraph", "summary"),
}


@dataclass(frozen=True)
class Call:
    """A call of Snakemake: files and rules, and whether jobs run, only the plan is shown, or results are reported."""

    targets: tuple[str, ...] = ()
    makes_results: bool = True
    dry_run: bool = False
    reports: bool = False


def read_call(arguments: Sequence[str]) -> Call:
    """Read a command line with Snakemake's own parser: a workflow learns of it too late for checks."""
    # Slow to import, and not needed by stages.
    from snakemake.cli import get_argument_parser

    options = vars(get_argument_parser().parse_args(list(arguments)))
    given = {name for name, value in options.items() if value}
    makes_results = "report_after_run" in given or not given & _MAKES_NOTHING
    return Call(
        targets=tuple(options["targets"] or ()),
        makes_results=makes_results,
        dry_run=bool(options["dryrun"]),
        reports="report" in given and not makes_results,
    )


def tell_failures_at_exit(logs: Iterable[str]) -> None:
    """Print the messages of failed stages at the end of the process, after Snakemake's own, from its log files."""
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
