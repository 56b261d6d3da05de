"""Where the workflow is."""

from pathlib import Path

# The workflow's file and its presets, relative to the folder of the workflow.
SNAKEFILE, PRESETS = Path("workflow/Snakefile"), Path("config/presets")


def snakefile() -> Path:
    """Get the path of the Snakefile: that of the working directory, else of the source tree."""
    return SNAKEFILE if SNAKEFILE.is_file() else Path(__file__).resolve().parents[3] / SNAKEFILE


def presets_folder() -> Path:
    """Get the folder of the presets: that of the working directory, else of the workflow."""
    return PRESETS if PRESETS.is_dir() else snakefile().parents[1] / PRESETS
