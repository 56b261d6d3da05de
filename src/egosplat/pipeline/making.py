"""The command that makes a result."""

import re
import shlex
from pathlib import Path

# Where the workflow puts results, which its targets name from the folder of the workflow.
_RESULT = re.compile(r"(?:^|/)(results/[a-z0-9_]+/.+)")


def make_command(path: Path, flag: str = "") -> str:
    """The shell command that makes a result, from any working directory; in words for a file of another place.

    Args:
        flag: of Snakemake, with a blank behind it.
    """
    place = path.as_posix()
    if (found := _RESULT.search(place)) is None:
        return "run its command again"
    root = Path(place[: found.start(1)])
    command = f"snakemake --cores 2 {flag}{shlex.quote(found[1])}"
    return command if root.absolute() == Path.cwd() else f"cd {shlex.quote(str(root))} && {command}"
