"""Check of a finished scene's folder, before anything in it is opened."""

import shlex
from collections.abc import Iterable
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.scenes import requested_targets

# Example of a scene folder for messages.
EXAMPLE = "results/adt/scene1"


def check_scene_folder(folder: Path, stages: Iterable[str]) -> None:
    """Check that a folder holds the artifacts of ``stages``. Their content is not read.

    Raises:
        UserError: it is not a folder, or artifacts are missing; names them and the command that makes them.
    """
    if folder.suffix == ".zarr" or (folder / "zarr.json").is_file():
        raise UserError(f"{folder}: is a single artifact; give the folder of its scene, {folder.parent}")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file; give the folder of a scene, such as {EXAMPLE}")
    missing = [f"{stage}.zarr" for stage in stages if not (folder / f"{stage}.zarr").exists()]
    if missing:
        lack = f"lacks {', '.join(missing)}" if folder.exists() else "does not exist"
        raise UserError(f"{folder}: {lack}. {_advice(folder)}")


def _advice(folder: Path) -> str:
    found = requested_targets([f"{folder}/metrics.json"])
    if not found:
        return f"Give the folder of a finished scene, such as {EXAMPLE}"
    if found[0].variant is not None:
        return f"A variant shares artifacts with its scene; give the scene's folder, {folder.parent.parent}"
    return f"Make the scene: snakemake --cores 2 {shlex.quote(f'{folder}/metrics.json')}"
