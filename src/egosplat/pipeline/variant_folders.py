"""Folders of variants."""

from pathlib import Path


def shared_with(folder: Path) -> list[Path]:
    """List the folders that may hold artifacts of a variant: its scene's, then those of all variants; none for a scene."""
    # A variant shares artifacts with its scene and with the variants that it extends.
    if folder.parent.name != "variants":
        return []
    return [folder.parent.parent, *sorted(folder.parent.iterdir())]
