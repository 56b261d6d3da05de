"""Where the workflow and its configuration are: in a checkout, or inside the installed package."""

from pathlib import Path

from egosplat import __version__

_PACKAGE = Path(__file__).resolve().parents[1]

# setup.py copies workflow/ and config/ into this folder of a wheel.
_SHIPPED = _PACKAGE / "shipped"

# Relative to a folder with a workflow of its own, which Snakemake finds by itself.
SNAKEFILE = Path("workflow/Snakefile")

_CONFIG, _PRESETS, _SCENES = Path("config/config.yaml"), Path("config/presets"), Path("config/scenes.tsv")


def snakefile() -> Path:
    """Get the path of the Snakefile: that of the working directory, else of ``_home``."""
    return SNAKEFILE if SNAKEFILE.is_file() else _home() / SNAKEFILE


def config_file() -> Path:
    """Get the configuration that is read first: that of the working directory, else of ``_home``."""
    return _CONFIG if _CONFIG.exists() else _home() / _CONFIG


def presets_folder() -> Path:
    """Get the folder of the presets: that of the working directory, else of ``_home``."""
    return _PRESETS if _PRESETS.is_dir() else _home() / _PRESETS


def scenes_table(named: Path) -> Path:
    """Get the table of scenes that a configuration names; for the default name without a file, that of ``_home``."""
    return _home() / _SCENES if named == _SCENES and not named.exists() else named


def how_to_reinstall() -> str:
    """Get the command that compiles the C++ code again."""
    if not _SHIPPED.is_dir():
        return "run make install, or pip install --no-build-isolation --no-deps -e ."
    # pip keeps the wheels that it has built, one without kernels too.
    fresh = "--force-reinstall --no-deps --no-cache-dir"
    return f"install the source distribution: run pip install {fresh} egosplat-{__version__}.tar.gz"


def _home() -> Path:
    """Get the folder of ``workflow`` and ``config``: the checkout, or a folder of the installed package."""
    return _SHIPPED if _SHIPPED.is_dir() else _PACKAGE.parents[1]
