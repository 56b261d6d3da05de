"""Check of a finished scene's folder, before anything in it is opened."""

from collections.abc import Iterable
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.config import read_yaml, resolve
from egosplat.pipeline.home import config_file, make_command, presets_folder, shared_with
from egosplat.pipeline.scenes import requested_targets
from egosplat.pipeline.variants import check_target, read_scenes_with_presets

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
    """How to make what a folder lacks, or why the workflow cannot with the working directory's configuration."""
    found = requested_targets([f"{folder}/metrics.json"])
    if not found:
        return f"Give the folder of a finished scene, such as {EXAMPLE}"
    what = "scene" if found[0].variant is None else "variant"
    command = make_command(folder / "metrics.json")
    presets = presets_folder()
    try:
        config = resolve(read_yaml(config_file()), presets)
        check_target(read_scenes_with_presets(config, presets), found[0])
    except UserError as error:
        return str(error)
    return f"Make the {what}: {command}"
