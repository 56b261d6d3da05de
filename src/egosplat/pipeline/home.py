"""Where the workflow, its configuration and its results are, and the command that makes a result."""

import contextlib
import difflib
import json
import os
import re
import shlex
from collections.abc import Iterable
from pathlib import Path

from egosplat import __version__
from egosplat.errors import UserError

# setup.py copies workflow/ and config/ into this folder of a wheel.
_PACKAGE = Path(__file__).resolve().parents[1]
_SHIPPED = _PACKAGE / "shipped"
_HOME = _SHIPPED if _SHIPPED.is_dir() else _PACKAGE.parents[1]

# Relative to a folder with a workflow of its own, which Snakemake finds by itself.
SNAKEFILE = Path("workflow/Snakefile")
_SNAKEFILES = ("Snakefile", "snakefile", SNAKEFILE)
CONFIG, PRESETS = Path("config/config.yaml"), Path("config/presets")

# Where the workflow puts results, which its targets name from the folder of the workflow. A folder above may be called so, too.
_RESULT = re.compile(r"(?:^|/)(results/[a-z0-9_]+(?:/[\w-]+(?:/variants/[\w-]+|/tradeoff)?)?/[^/]+)$")
_SCENE = re.compile(r"(.*/)?results/[a-z0-9_]+/[\w-]+(/variants/[\w-]+)?")

SETTINGS = "EGOSPLAT_SETTINGS"  # environment variable: what Snakemake's command sets, for artifacts to record
EXAMPLE = "results/adt/scene1"  # of a scene's folder, for messages

# Where a scene keeps names, and its own fit of grades: beside its artifacts, and neither an input nor an output of a stage.
NAMES, OWN_FITS = "names.json", "grades.csv"

# Artifacts of a scene that can be asked; its codes name one more, features or tiles.
ASKED = ("frames", "poses", "splats", "language")


def find_home(path: Path) -> Path:
    """Find a file of the workflow or its configuration, as ``config/config.yaml``: in the working directory, else as it comes
    with egosplat, in a checkout or the installed package."""
    # Another Snakemake project may live in the working directory.
    is_other = any(Path(name).is_file() for name in _SNAKEFILES)
    if path.exists() and (has_workflow(Path()) or not is_other):
        return path
    return _HOME / path


def has_workflow(folder: Path) -> bool:
    """Whether a folder has egosplat's workflow, or one that deploys it as a module, and not that of another project."""
    paths = [folder / name for name in _SNAKEFILES]
    return any(path.is_file() and "egosplat" in path.read_text(errors="replace") for path in paths)


PRESET_NAMES = sorted(
    {path.stem for folder in (find_home(PRESETS), _HOME / PRESETS) for path in folder.glob("[!.]*.yaml")}
)


def find_preset(folder: Path, name: str) -> Path:
    """Find the file of a preset in a folder, which may have one of its own, else as it comes with egosplat."""
    own = folder / f"{name}.yaml"
    return own if own.exists() else _HOME / PRESETS / own.name


def how_to_reinstall() -> str:
    """Get the command that compiles the C++ code again."""
    if not _SHIPPED.is_dir():
        return "run make install, or pip install --no-build-isolation --no-deps -e ."
    # pip keeps the wheels that it has built, one without kernels too.
    fresh = "--force-reinstall --no-deps --no-cache-dir"
    return f"install the source distribution: run pip install {fresh} egosplat-{__version__}.tar.gz"


def make_command(path: Path, *others: Path, flag: str = "") -> str:
    """The shell command that makes a result, with others of its folder, from any working directory; ``flag`` ends with a blank."""
    if (match := _RESULT.search(path.as_posix())) is None:
        return "run its command again"
    root = Path(path.as_posix()[: match.start(1)])
    target = shlex.join([match[1], *(str(other.relative_to(root)) for other in others)])
    folder = shlex.quote(str(root))
    # Results may lie apart from the workflow, by Snakemake's option --directory.
    words = f"{_settings_of(root / match[1])}--cores 2 {flag}"
    if root.resolve() != Path.cwd() and has_workflow(Path()) and not has_workflow(root):
        return f"snakemake {words}--directory {folder} {target}"
    snakemake = "snakemake" if has_workflow(root) else 'snakemake --snakefile "$(egosplat snakefile)"'
    place = "" if root.resolve() == Path.cwd() else f"cd {folder} && "
    return f"{place}{snakemake} {words}{target}"


def _settings_of(path: Path) -> str:
    """The words of Snakemake's command, with a blank, that tell with which settings the scene of a result was made."""
    # A newer artifact has the settings of a later command.
    of_variant, of_scene = (
        sorted(folder.glob("*.zarr/zarr.json"), key=os.path.getmtime, reverse=True)
        for folder in (path.parent, path.parents[2])
    )
    for metadata in (path / "zarr.json", *of_variant, *of_scene):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            made = json.loads(metadata.read_text())["attributes"]["egosplat"]["provenance"]
            return shlex.join(["--config", *shlex.split(made["settings"])]) + " " if made["settings"] else ""
    return ""


def shared_with(folder: Path) -> list[Path]:
    """List the folders that may hold artifacts of a variant: its scene's, then those of all variants; none for a scene."""
    # A variant shares artifacts with its scene and with the variants that it extends. A link to it may have any name.
    parent = folder.parent if folder.parent.name == "variants" else folder.resolve().parent
    return [parent.parent, *sorted(parent.iterdir())] if parent.name == "variants" else []


def check_scene_folder(folder: Path, stages: Iterable[str]) -> None:
    """Check that a folder holds artifacts, without reading them (UserError: names what makes those missing)."""
    if folder.suffix == ".zarr" or (folder / "zarr.json").is_file():
        raise UserError(f"{folder}: is a single artifact; give the folder of its scene, {folder.parent}")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file; give the folder of a scene, such as {EXAMPLE}")
    places = [folder, *shared_with(folder)] if folder.exists() else []
    names = [f"{stage}.zarr" for stage in stages]
    missing = [name for name in names if not any((place / name).exists() for place in places)]
    if missing:
        lack = f"lacks {', '.join(missing)}" if folder.exists() else "does not exist"
        advice = f"Give the folder of a finished scene, such as {EXAMPLE}"
        if (match := _SCENE.fullmatch(folder.as_posix())) and Path(match[1] or ".").is_dir():
            # A variant shares what its last artifact is made from.
            what, made = ("variant", missing[-1:]) if match[2] else ("scene", missing)
            advice = f"Make the {what}: {make_command(*(folder / name for name in made))}"
        others = [] if folder.exists() else [other.name for other in folder.parent.glob("*/")]
        if near := difflib.get_close_matches(folder.name, others, 1, 0.8):
            advice = f"Did you mean {folder.with_name(near[0])}? {advice}"
        raise UserError(f"{folder}: {lack}. {advice}")


def title_of(folder: Path) -> str:
    """Title of a scene or variant, such as ``adt/scene1`` or ``adt/scene1, baseline``, from its folder."""
    *_, dataset, scene, variants, name = ("", "", *folder.absolute().parts)
    return f"{dataset}/{scene}, {name}" if variants == "variants" else f"{variants}/{name}"
