"""Where the workflow and its configuration are: in a checkout, or inside the installed package."""

from pathlib import Path

from egosplat import __version__

_PACKAGE = Path(__file__).resolve().parents[1]

# setup.py copies workflow/ and config/ into this folder of a wheel.
_SHIPPED = _PACKAGE / "shipped"

CONFIG, PRESETS, SCENES = Path("config/config.yaml"), Path("config/presets"), Path("config/scenes.tsv")


def is_installed() -> bool:
    """Whether the package was installed from a wheel, which holds the workflow."""
    return _SHIPPED.is_dir()


def folder() -> Path:
    """The folder of ``workflow`` and ``config``: the checkout, or a folder of the installed package."""
    return _SHIPPED if is_installed() else _PACKAGE.parents[1]


def snakefile() -> Path:
    """The Snakefile of the workflow."""
    return folder() / "workflow/Snakefile"


def own_or_shipped(path: Path) -> Path:
    """``CONFIG``, ``PRESETS`` or ``SCENES`` of the working directory, or else of ``folder``; any other path as it is."""
    is_absent = path in (CONFIG, PRESETS, SCENES) and not path.exists()
    return folder() / path if is_absent else path


def how_to_reinstall() -> str:
    """The command that compiles the C++ code again."""
    if not is_installed():
        return "run make install, or pip install --no-build-isolation --no-deps -e ."
    # pip keeps the wheels that it has built, one without kernels too.
    fresh = "--force-reinstall --no-deps --no-cache-dir --no-binary egosplat"
    return f"run pip install {fresh} egosplat=={__version__}"
