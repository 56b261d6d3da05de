"""The command that makes a result."""

import re
import shlex
from pathlib import Path

from egosplat.pipeline.home import SNAKEFILE

# Where the workflow puts results, which its targets name from the folder of the workflow.
_RESULT = re.compile(r"(?:^|/)(results/[a-z0-9_]+/.+)")


def snakemake_in(folder: Path) -> str:
    """The command ``snakemake`` in a folder; without a workflow of its own, with the one that comes with egosplat."""
    has_workflow = (folder / SNAKEFILE).is_file()
    return "snakemake" if has_workflow else 'snakemake --snakefile "$(egosplat snakefile)"'


def make_command(path: Path, flag: str = "") -> str:
    """The shell command that makes a result, from any working directory; in words for a file of another place.

    Args:
        flag: of Snakemake, with a blank behind it.
    """
    place = path.as_posix()
    if (found := _RESULT.search(place)) is None:
        return "run its command again"
    root, target = Path(place[: found.start(1)]), shlex.quote(found[1])
    if root.resolve() == Path.cwd():
        return f"{snakemake_in(root)} --cores 2 {flag}{target}"
    # Results may lie apart from the workflow, by Snakemake's option --directory.
    if SNAKEFILE.is_file() and not (root / SNAKEFILE).is_file():
        return f"snakemake --cores 2 {flag}--directory {shlex.quote(str(root))} {target}"
    return f"cd {shlex.quote(str(root))} && {snakemake_in(root)} --cores 2 {flag}{target}"
