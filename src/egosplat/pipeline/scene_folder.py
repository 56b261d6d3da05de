"""Check of a finished scene's folder, before anything in it is opened."""

import re
from collections.abc import Iterable
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.home import make_command, shared_with

# Example of a scene folder for messages.
EXAMPLE = "results/adt/scene1"

# Artifacts of a scene that can be asked; its codes name one more, features or tiles.
ASKED = ("frames", "poses", "splats", "language")


def check_scene_folder(folder: Path, stages: Iterable[str]) -> None:
    """Check that a folder holds artifacts, without reading them (UserError: names what makes those missing)."""
    if folder.suffix == ".zarr" or (folder / "zarr.json").is_file():
        raise UserError(f"{folder}: is a single artifact; give the folder of its scene, {folder.parent}")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file; give the folder of a scene, such as {EXAMPLE}")
    places = [folder, *shared_with(folder)] if folder.exists() else []
    missing = [
        f"{stage}.zarr" for stage in stages if not any((place / f"{stage}.zarr").exists() for place in places)
    ]
    if missing:
        lack = f"lacks {', '.join(missing)}" if folder.exists() else "does not exist"
        raise UserError(f"{folder}: {lack}. {_advice(folder)}")


def title_of(folder: Path) -> str:
    """Title of a scene or variant, such as ``adt/scene1`` or ``adt/scene1, baseline``, from its folder."""
    *_, dataset, scene, variants, name = ("", "", *folder.absolute().parts)
    return f"{dataset}/{scene}, {name}" if variants == "variants" else f"{variants}/{name}"


def _advice(folder: Path) -> str:
    """How to make what a folder lacks."""
    found = re.fullmatch(r"(?:\./)?results/[a-z0-9_]+/[\w-]+(/variants/[\w-]+)?", folder.as_posix())
    if not found:
        return f"Give the folder of a finished scene, such as {EXAMPLE}"
    what = "variant" if found[1] else "scene"
    return f"Make the {what}: {make_command(folder / 'metrics.json')}"
