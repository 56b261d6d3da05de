"""What a call of Snakemake asks for. Snakemake tells a workflow only after it has read it, too late for a plain message."""

from collections.abc import Sequence
from dataclasses import dataclass

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
"""Options with which Snakemake makes no results, by their names in its parser."""


@dataclass(frozen=True)
class Call:
    """A call of Snakemake.

    Attributes:
        targets: files and rules that it names.
        makes_results: whether jobs run.
        dry_run: whether it shows the plan alone.
        reports: whether it makes the report of the results that exist, and no results.
    """

    targets: tuple[str, ...] = ()
    makes_results: bool = True
    dry_run: bool = False
    reports: bool = False


def read_call(arguments: Sequence[str]) -> Call:
    """Read a command line with Snakemake's own parser.

    Args:
        arguments: of Snakemake, without its name. Snakemake has already accepted them.
    """
    # Slow to import, and no use to a stage.
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
