"""Where the workflow, its configuration and its results are, and the command that makes a result."""

import re
import shlex
from pathlib import Path

from egosplat import __version__

_PACKAGE = Path(__file__).resolve().parents[1]

# setup.py copies workflow/ and config/ into this folder of a wheel.
_SHIPPED = _PACKAGE / "shipped"

# Relative to a folder with a workflow of its own, which Snakemake finds by itself.
SNAKEFILE = Path("workflow/Snakefile")

# Where Snakemake looks for the workflow of a project.
_SNAKEFILES = ("Snakefile", "snakefile", SNAKEFILE)

# Where the workflow puts results, which its targets name from the folder of the workflow.
_RESULT = re.compile(r"(?:^|/)(results/[a-z0-9_]+/.+)")

_CONFIG, _PRESETS, _SCENES = Path("config/config.yaml"), Path("config/presets"), Path("config/scenes.tsv")


def snakefile() -> Path:
    """Get the path of the Snakefile: that of the working directory, else of ``_home``."""
    return _here_or_home(SNAKEFILE)


def config_file() -> Path:
    """Get the configuration that is read first: that of the working directory, else of ``_home``."""
    return _here_or_home(_CONFIG)


def presets_folder() -> Path:
    """Get the folder of the presets: that of the working directory, else of ``_home``."""
    return _here_or_home(_PRESETS)


def scenes_table(named: Path) -> Path:
    """Get the table of scenes that a configuration names; for the default name without a file, that of ``_home``."""
    return _here_or_home(named) if named == _SCENES else named


def _here_or_home(path: Path) -> Path:
    """A file of the working directory, unless a Snakemake project of its own lives there; else that of ``_home``."""
    is_other = any(Path(name).is_file() for name in _SNAKEFILES) and not has_workflow(Path())
    return path if path.exists() and not is_other else _home() / path


def has_workflow(folder: Path) -> bool:
    """Whether a folder has egosplat's workflow, and not that of another project."""
    path = folder / SNAKEFILE
    return path.is_file() and "egosplat" in path.read_text(errors="replace")


def how_to_reinstall() -> str:
    """Get the command that compiles the C++ code again."""
    if not _SHIPPED.is_dir():
        return "run make install, or pip install --no-build-isolation --no-deps -e ."
    # pip keeps the wheels that it has built, one without kernels too.
    fresh = "--force-reinstall --no-deps --no-cache-dir"
    return f"install the source distribution: run pip install {fresh} egosplat-{__version__}.tar.gz"


def _home() -> Path:
    """Get the folder of ``workflow`` and ``config``: a checkout, or a folder of the installed package."""
    return _SHIPPED if _SHIPPED.is_dir() else _PACKAGE.parents[1]


def snakemake_in(folder: Path) -> str:
    """The command ``snakemake`` in a folder; without a workflow of its own, with the one that comes with egosplat."""
    return "snakemake" if has_workflow(folder) else 'snakemake --snakefile "$(egosplat snakefile)"'


def make_command(path: Path, flag: str = "") -> str:
    """The shell command that makes a result, from any working directory; ``flag`` ends with a blank."""
    place = path.as_posix()
    if (found := _RESULT.search(place)) is None:
        return "run its command again"
    root, target = Path(place[: found.start(1)]), shlex.quote(found[1])
    if root.resolve() == Path.cwd():
        return f"{snakemake_in(root)} --cores 2 {flag}{target}"
    # Results may lie apart from the workflow, by Snakemake's option --directory.
    if has_workflow(Path()) and not has_workflow(root):
        return f"snakemake --cores 2 {flag}--directory {shlex.quote(str(root))} {target}"
    return f"cd {shlex.quote(str(root))} && {snakemake_in(root)} --cores 2 {flag}{target}"


def shared_with(folder: Path) -> list[Path]:
    """List the folders that may hold artifacts of a variant: its scene's, then those of all variants; none for a scene."""
    # A variant shares artifacts with its scene and with the variants that it extends.
    if folder.parent.name != "variants":
        return []
    return [folder.parent.parent, *sorted(folder.parent.iterdir())]
