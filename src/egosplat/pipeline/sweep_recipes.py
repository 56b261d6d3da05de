"""How to make a point of the trade-off: the keys that differ from the defaults, and the command."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from egosplat.pipeline.config import Config, defaults, stage_sections
from egosplat.pipeline.making import snakemake_in
from egosplat.pipeline.model_sets import automatic_set, choose_set
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.variants import variant_config, variant_folder


@dataclass(frozen=True)
class Recipe:
    """How to make a point.

    Attributes:
        keys: value by key, such as ``splats.iterations``, of all keys of stages that differ from their defaults.
        command: command line that makes the point's scores.
    """

    keys: dict[str, Any]
    command: str

    def as_json(self) -> dict[str, Any]:
        """The recipe as in ``tradeoff.schema.yaml``."""
        return asdict(self)


def recipe_of(scene: Scene, variant: str | None) -> Recipe:
    """Get the recipe of a scene or one of its variants.

    Raises:
        UserError: see ``egosplat.pipeline.variants.variant_config``.
    """
    config = variant_config(scene.config, variant, scene.name) if variant else scene.config
    preset = (
        ""
        if scene.config["preset"] == defaults()["preset"]
        else f"--config preset={scene.config['preset']} -- "
    )
    target = f"{scene.results}/{variant_folder(variant)}metrics.json"
    usual = choose_set(defaults(), automatic_set("synthetic" if scene.synthetic else "real"))
    return Recipe(changed_keys(config, usual), f"{snakemake_in(Path())} --cores 2 {preset}{target}")


def changed_keys(config: Config, usual: Config) -> dict[str, Any]:
    """Get the keys of stages that differ from the usual configuration, without those of the recording."""
    sections = [name for name in config if name in _recipe_sections()]
    return {
        f"{section}.{key}": value
        for section in sections
        for key, value in config[section].items()
        if value != usual[section][key]
    }


def _recipe_sections() -> set[str]:
    """Sections of stages, and those that stages share; all points have the recording of the scene."""
    return {section for stage in STAGES if stage != "synthetic" for section in stage_sections(stage)}
