"""Variants of a scene: named sets of keys over its own, and which artifacts they make anew.

An artifact of a variant is one of its own only where one of the variant's keys reaches its stage or a stage before it;
else it is the scene's, or that of a variant which it stands over. So variants share all that they have in common.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import inputs_of
from egosplat.pipeline.scenes import Scene, Target, check_recording, find_scene
from egosplat.pipeline.stages import STAGES

EXTENDS = "extends"
"""Key of a variant that names another, or a list of others, whose keys its own stand over; later ones over earlier."""

NAMED = 8
"""So many variants are named in a message."""


def reaches(stage: str, base: Config, variant: Config) -> bool:
    """Whether a variant's artifact of a stage is another than the scene's."""
    if configuration.stage_values(stage, base) != configuration.stage_values(stage, variant):
        return True
    inputs = inputs_of(stage, variant)
    return inputs != inputs_of(stage, base) or any(reaches(name, base, variant) for name in inputs)


def owner(stage: str, base: Config, name: str, where: str) -> str | None:
    """The variant in whose folder a variant's artifact of a stage lies: itself, one that it stands over, or None for
    the scene.

    Args:
        stage: of the artifact.
        base: the scene's configuration.
        name: of the variant.
        where: the scene, for messages.

    Raises:
        UserError: as ``variant_config``.
    """
    own = variant_config(base, name, where)
    if not reaches(stage, base, own):
        return None
    for below in _below(base["variants"], name):
        if not reaches(stage, variant_config(base, below, where), own):
            return owner(stage, base, below, where)
    return name


def variant_config(base: Config, name: str, where: str) -> Config:
    """A scene's configuration with a variant's keys over it.

    Args:
        base: the scene's configuration.
        name: of the variant.
        where: the scene, for messages.

    Raises:
        UserError: there is no such variant, or a key of it is not allowed.
    """
    merged = base
    for one in _ancestry(base["variants"], name, where):
        keys = {key: value for key, value in base["variants"][one].items() if key != EXTENDS}
        merged = configuration.merge(merged, keys)
    configuration.check(merged, f"variant {name}")
    if merged["synthetic"] != base["synthetic"]:
        raise UserError(f"variant {name}: recordings are a scene's own; leave out the section synthetic")
    if merged["preset"] != base["preset"]:
        raise UserError(
            f"variant {name}: preset is chosen for all; leave it out, and give the keys themselves"
        )
    return merged


def scene_config(scene: Scene, variant: str | None) -> Config:
    """The configuration of a scene or of a variant of it; errors as ``variant_config``."""
    return variant_config(scene.config, variant, scene.name) if variant else scene.config


def variant_folder(variant: str | None) -> str:
    """The folder of a variant below its scene's: ``variants/NAME/``, empty for the scene itself."""
    return f"variants/{variant}/" if variant else ""


def artifact_folder(stage: str, scene: Scene, variant: str | None) -> str:
    """The folder, below the scene's, of the artifact that a variant has from a stage, its own or a shared one.

    Raises:
        UserError: as ``variant_config``.
    """
    return variant_folder(owner(stage, scene.config, variant, scene.name) if variant else None)


def artifact_path(stage: str, scene: Scene, variant: str | None) -> str:
    """The path of that artifact; errors as ``artifact_folder``."""
    return f"{scene.results}/{artifact_folder(stage, scene, variant)}{STAGES[stage].output}"


def check_target(scenes: Mapping[tuple[str, str], Scene], target: Target) -> None:
    """Check that a path of the command line can be made, before Snakemake looks for a rule.

    Raises:
        UserError: no such scene or variant, no recording, or an artifact that the variant shares; names its path.
    """
    scene = find_scene(scenes, target.dataset, target.scene)
    check_recording(scene)
    if target.variant is None:
        return
    variant_config(scene.config, target.variant, scene.name)
    stage = target.name.partition(".")[0]
    if (
        stage not in STAGES
        or target.name != STAGES[stage].output
        or not target.name.endswith((".zarr", ".json"))
    ):
        return
    home = artifact_folder(stage, scene, target.variant)
    if home != variant_folder(target.variant):
        raise UserError(
            f"variant {target.variant} changes nothing of {target.name}; take {scene.results}/{home}{target.name}"
        )


def _ancestry(variants: Mapping[str, Mapping[str, Any]], name: str, where: str) -> list[str]:
    """The variants that a variant stands over, each once, those whose keys stand over others' later, and itself."""
    found: list[str] = []

    def visit(one: str, above: tuple[str, ...]) -> None:
        if one in above:
            raise UserError(
                f"variant {name}: stands over itself ({', '.join(above)}); change its key {EXTENDS!r}"
            )
        if one not in variants:
            raise UserError(
                f"{where}: no variant {one!r}. Add it to the configuration key 'variants', "
                f"or take one of: {_some(variants)}"
            )
        if one not in found:
            for below in _below(variants, one):
                visit(below, (*above, one))
            found.append(one)

    visit(name, ())
    return found


def _below(variants: Mapping[str, Mapping[str, Any]], name: str) -> list[str]:
    """Those that a variant stands over itself."""
    below = variants[name].get(EXTENDS, [])
    return [below] if isinstance(below, str) else below


def _some(names: Iterable[str]) -> str:
    """At most ``NAMED`` of them."""
    every = list(names)
    more = [f"{len(every) - NAMED} more"] if len(every) > NAMED else []
    return ", ".join([*every[:NAMED], *more]) or "none"
