"""What the workflow checks before Snakemake says or writes anything."""

from collections.abc import Iterable
from pathlib import Path

from egosplat.config import read_yaml
from egosplat.errors import UserError

_JSON = ".json"


def check_cores(cores: int | None, nodes: int | None) -> None:
    """Check that something can run: with no core, or no job at once, Snakemake waits without end.

    Args:
        cores: of ``--cores``; nodes: of ``--jobs`` on a cluster; None where not given.

    Raises:
        UserError: one of them is less than 1.
    """
    for option, count in (("--cores", cores), ("--jobs", nodes)):
        if count is not None and count < 1:
            raise UserError(f"{option} {count}: nothing can run; give 1 or more, as in {option} 2")


def check_config_files(paths: Iterable[Path]) -> None:
    """Check that each configuration file is YAML in which no key stands twice; Snakemake takes the last and says nothing.

    Raises:
        UserError: names the file and the line.
    """
    for path in paths:
        if path.suffix != _JSON:
            read_yaml(path)
