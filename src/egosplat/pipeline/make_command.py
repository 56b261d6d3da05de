"""The command that makes a result, for messages."""

import shlex
from pathlib import Path


def make_command(path: Path, *flags: str) -> str:
    """Get Snakemake's command for a result. For one below another working directory, it names that directory.

    Args:
        path: of a result, from anywhere.
        flags: of Snakemake.
    """
    parts = path.parts
    start = len(parts) - 1 - parts[::-1].index("results") if "results" in parts else 0
    home = Path(*parts[:start])
    elsewhere = [] if home.resolve() == Path.cwd() else ["--directory", str(home)]
    return shlex.join(["snakemake", "--cores", "2", *flags, *elsewhere, str(Path(*parts[start:]))])
