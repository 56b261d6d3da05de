"""Variants of a scene: named sets of keys, presets among them, and the artifacts that they change."""

import functools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from egosplat.calibration.files import chosen_poses
from egosplat.errors import UserError
from egosplat.pipeline.config import (
    OF_SCENES,
    SHIPPED_LAYER,
    Config,
    Layer,
    LayeredConfig,
    configure,
    layers_of_format,
    merge_layers,
    stage_values,
)
from egosplat.pipeline.dag import inputs_of
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.home import PRESET_NAMES, find_preset
from egosplat.pipeline.model_sets import DEFAULTS, PUBLISHED, locate_checkpoints
from egosplat.pipeline.scenes import Scene, read_scenes
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.strict_yaml import read_yaml

# Preset file by name of the variant.
PRESET_FILES = {"paper_scaled" if name == "paper" else name: name for name in PRESET_NAMES}

# Sections and keys that keep the scene's value with every preset: those that define frames and queries, because scores with
# different values cannot be compared, and models (transient.lr suits the encoder).
_KEPT = {
    *("formats", "synthetic", "annotations", "metrics", "models", "transient.lr", "query.readout"),
    *(f"frames.{name}" for name in ("stride", "start_s", "end_s", "evaluation_frames", "holdout")),
}


def read_scenes_with_presets(config: LayeredConfig, presets: Path) -> dict[tuple[str, str], Scene]:
    """Read the table of scenes, as ``read_scenes``; each preset is a variant of its name, unless another one has it."""
    scenes = read_scenes(config).items()
    return {key: replace(s, config=with_presets(s.config, presets, s.format)) for key, s in scenes}


def with_presets(config: LayeredConfig, presets: Path, format: str) -> LayeredConfig:
    """Add the presets to the variants of a scene's configuration, behind the user's own."""

    def named(models: str) -> dict[str, Config]:
        names = (name for name in PRESET_FILES if name not in config["variants"])
        return {name: preset_keys(name, presets, format, models) for name in names}

    variants = config["variants"] | named(config["models"]["set"])
    found = LayeredConfig(config | {"variants": variants}, config.layers)
    found.presets = named
    return found


def reaches(stage: str, base: Config, variant: Config) -> bool:
    """Whether a variant changes a stage's artifact."""
    if stage_values(stage, base) != stage_values(stage, variant):
        return True
    inputs = inputs_of(stage, variant)
    # Other inputs, or an input that the variant changes. The graph has no cycles, so this ends.
    return inputs != inputs_of(stage, base) or any(reaches(name, base, variant) for name in inputs)


def owner(stage: str, base: LayeredConfig, name: str, where: str) -> str | None:
    """Get the owner of a variant's artifact: the variant, one that it extends, or None for the scene."""
    own = variant_config(base, name, where)
    # A variant has its own artifact only if it differs from the scene's and from those of the variants it extends.
    if not reaches(stage, base, own):
        return None
    for below in _extended(base["variants"], name):
        if not reaches(stage, variant_config(base, below, where), own):
            return owner(stage, base, below, where)
    return name


def variant_config(base: LayeredConfig, name: str, where: str) -> LayeredConfig:
    """Get the configuration of a scene's variant: its keys, and those of variants that it extends, are layers
    above the scene's (UserError: there is no such variant, or a key is not allowed)."""
    if name in base.variants:
        return base.variants[name]
    ancestry, models = _ancestry(base["variants"], name, where), base["models"]["set"]

    def layered(variants: Mapping[str, Config]) -> LayeredConfig:
        above = [Layer(f"variant {one}", _keys_of(variants[one], base, name)) for one in ancestry]
        return configure([*base.layers, *above], automatic=models)  # a variant's ``auto`` is the scene's set

    config = layered(base["variants"])
    if (chosen := config["models"]["set"]) != models:
        config = layered(base["variants"] | base.presets(chosen))
    if config["synthetic"] != base["synthetic"]:
        shared = "variants share the scene's recording; leave out the section synthetic"
        raise UserError(f"variant {name}: {shared}")
    base.variants[name] = config
    return config


def _keys_of(variant: Config, base: Config, name: str) -> Config:
    """The keys of the configuration among those of a variant, for the variant of a name that is or extends it."""
    keys = {key: value for key, value in variant.items() if key not in ("extends", "method")}
    for key in (*GeneralOptions.model_fields, *OF_SCENES):
        if keys.get(key, base[key]) != base[key]:
            raise UserError(f"variant {name}: a variant cannot change {key}; it holds for all of a scene")
    return keys


def scene_config(scene: Scene, variant: str | None) -> Config:
    """Get the configuration of a scene or one of its variants, with the paths of published checkpoints."""
    return locate_checkpoints(variant_config(scene.config, variant, scene.name) if variant else scene.config)


def method_of(base: Config, name: str, where: str) -> str | None:
    """Get the published method that a variant stands for; None for EgoSplat."""
    methods = [base["variants"][above].get("method") for above in _ancestry(base["variants"], name, where)]
    return next(filter(None, reversed(methods)), None)


def preset_of(base: Config, name: str | None, where: str) -> str:
    """Get the preset of a scene, or of its variant that is one or extends one."""
    names = _ancestry(base["variants"], name, where) if name else []
    return next((above for above in reversed(names) if above in PRESET_FILES), base["preset"])


def variant_folder(variant: str | None) -> str:
    """Get the folder of a variant below its scene, ``variants/NAME/``; empty for the scene itself."""
    return f"variants/{variant}/" if variant else ""


def artifact_path(stage: str, scene: Scene, variant: str | None) -> str:
    """Get the path of a variant's artifact, its own or a shared one."""
    name = owner(stage, scene.config, variant, scene.name) if variant else None
    return f"{scene.results}/{variant_folder(name)}{STAGES[stage].output}"


def _ancestry(variants: Mapping[str, Mapping[str, Any]], name: str, where: str) -> list[str]:
    """Get a variant and all that it extends, in the order in which their keys are merged."""
    merged: dict[str, None] = {}

    def visit(variant: str, above: tuple[str, ...]) -> None:
        if variant in above:
            circle = " -> ".join([*above, variant])
            raise UserError(f"variant {name}: circular inheritance {circle}. Fix its key 'extends'")
        if variant not in variants:
            more = [f"{len(variants) - 8} more"] if len(variants) > 8 else []
            advice = f"or take one of: {', '.join([*[*variants][:8], *more])}"
            told = f"{where}: no variant {variant!r}. Add it to the configuration key 'variants', {advice}"
            raise UserError(told)
        for below in _extended(variants, variant):
            visit(below, (*above, variant))
        merged.setdefault(variant)

    visit(name, ())
    return [*merged]


def _extended(variants: Mapping[str, Mapping[str, Any]], name: str) -> list[str]:
    """Get the variants that a variant extends directly."""
    below = variants[name].get("extends", [])
    return [below] if isinstance(below, str) else below


def chosen_value(stage: str, scene: Scene, config: Config) -> str | None:
    """Get the value by which a stage of a scene or variant chooses its module; None for a stage that chooses none."""
    match stage:
        case "frames" | "annotations":
            return scene.format
        case "poses":
            return chosen_poses(scene.format, scene.recording, config)
        case "language":
            return "joint" if config["splats"]["language"] == "joint" else config["language"]["method"]
    return None


@functools.cache
def _read_preset(path: Path) -> Config:
    """Read the file of a preset (UserError: a key or a value is wrong)."""
    layer = Layer(f"preset {path.name}", read_yaml(path))
    configure([layer])
    for format in layer.keys.get("formats", {}):
        configure([*layers_of_format([layer], format)])
    return dict(layer.keys)


@functools.cache
def preset_keys(name: str, folder: Path, format: str, models: str) -> Config:
    """Get a preset's keys as a variant's; ``paper_scaled`` is ``paper`` at the scene's resolution and models."""
    files = {file: _read_preset(find_preset(folder, file)) for file in PRESET_FILES.values()}
    kept = _KEPT | {"frames.resolution"} if name == "paper_scaled" else _KEPT
    preset, usual = Layer(name, files[PRESET_FILES[name]]), configure([SHIPPED_LAYER], models)
    values = merge_layers(layers_of_format([preset, SHIPPED_LAYER], format))
    # Set every key that any preset sets, so that no value of the scene's own preset remains.
    parts = [part for file in files.values() for part in (file, *file.get("formats", {}).values())]
    keys: Config = {}
    general = {*kept, *GeneralOptions.model_fields}
    sections = ((name, keys) for part in parts for name, keys in part.items() if name not in general)
    for section, key in ((name, key) for name, keys in sections for key in keys):
        if f"{section}.{key}" not in kept:
            value = values.get(section, {}).get(key, usual[section][key])
            keys.setdefault(section, {})[key] = value
    if name == "paper_scaled":  # other models can follow what comes with the paper's, too
        for section in ("view_features", "query"):
            keys[section] = keys.get(section, {}) | DEFAULTS[PUBLISHED][section]
    return keys
