"""Targets and options of a Snakemake call. Snakemake shows them to a workflow only after reading it, too late for checks."""

from collections.abc import Sequence
from dataclasses import dataclass

# Options with which Snakemake makes no results, named as in its parser.
_MAKES_NOTHING = {
    "d3dag",
    "dag",
    "detailed_summary",
    "dryrun",
    "filegraph",
    "lint",
    "list_changes",
    "list_conda_envs",
    "list_input_changes",
    "list_params_changes",
    "list_rules",
    "list_target_rules",
    "list_untracked",
    "report",
    "rulegraph",
    "summary",
}


@dataclass(frozen=True)
class Call:
    """A call of Snakemake.

    Attributes:
        targets: requested files and rules.
        makes_results: whether jobs run.
        dry_run: whether it only shows the plan.
        reports: whether it only reports existing results.
    """

    targets: tuple[str, ...] = ()
    makes_results: bool = True
    dry_run: bool = False
    reports: bool = False


def read_call(arguments: Sequence[str]) -> Call:
    """Read a command line with Snakemake's own parser.

    Args:
        arguments: command line without the program name. Snakemake has already accepted it.
    """
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
