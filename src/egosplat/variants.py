"""Variants of a scene: named sets of keys over its own, and which artifacts they make anew.

An artifact of a variant is one of its own only where one of the variant's keys reaches its stage or a stage before it;
else it is the scene's. So variants share all that they have in common.
"""

from egosplat import config as configuration
from egosplat.cli import OPTIONAL, PATHS
from egosplat.config import Config
from egosplat.errors import UserError
from egosplat.stages import STAGES

_MASKS: dict[str, tuple[str, ...]] = {"none": (), "initial": ("transient",), "refined": ("masks",)}
"""By splats.masking: the artifacts that say what moves."""

_CODES: dict[str, tuple[str, ...]] = {"after": (), "joint": ("segments", "features")}
"""By splats.language: the artifacts from which codes are trained with the geometry."""


def inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """The stages whose artifacts a stage reads, with a configuration."""
    always = tuple(name for name in PATHS[stage] if name in STAGES and name not in OPTIONAL.get(stage, ()))
    return always + optional_inputs_of(stage, config)


def optional_inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """Those of them that other configurations do without."""
    wanted = _MASKS[config["splats"]["masking"]] + _CODES[config["splats"]["language"]]
    return tuple(name for name in wanted if name in OPTIONAL.get(stage, ()))


def reaches(stage: str, base: Config, variant: Config) -> bool:
    """Whether a variant's artifact of a stage is another than the scene's."""
    if configuration.stage_values(stage, base) != configuration.stage_values(stage, variant):
        return True
    return any(reaches(name, base, variant) for name in inputs_of(stage, variant))


def variant_config(base: Config, name: str, where: str) -> Config:
    """A scene's configuration with a variant's keys over it.

    Args:
        base: the scene's configuration.
        name: of the variant.
        where: the scene, for messages.

    Raises:
        UserError: there is no such variant, or a key of it is not allowed.
    """
    variants = base["variants"]
    if name not in variants:
        known = ", ".join(variants) or "none"
        raise UserError(
            f"{where}: no variant {name!r}. Add it to the configuration key 'variants', or take one of: {known}"
        )
    merged = configuration.merge(base, variants[name])
    configuration.check(merged, f"variant {name}")
    if merged["synthetic"] != base["synthetic"]:
        raise UserError(f"variant {name}: recordings are a scene's own; leave out the section synthetic")
    return merged
