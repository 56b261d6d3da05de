"""The points of a trade-off: presets, and single keys with other values, each a variant of the scene.

A point that changes nothing is the scene itself. Each point is run with several seeds. The variants ``seed-1``, ... are
the scene with another seed; ``POINT-seed-1`` extends both the point and the seed, and shares their artifacts.
"""

import difflib
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline import variants
from egosplat.pipeline.config import Config, defaults, section_keys, stage_sections
from egosplat.pipeline.home import snakemake_in
from egosplat.pipeline.model_sets import automatic_set, choose_set
from egosplat.pipeline.scenes import Scene, read_scenes
from egosplat.pipeline.stages import STAGES

# The knob whose values are presets.
PRESET = "preset"

# Maximum length of a value in a variant's name [characters].
_LONGEST = 60


@dataclass(frozen=True)
class Setting:
    """A knob, ``preset`` or a key such as ``features.dims``, with a value."""

    knob: str
    value: Any


@dataclass(frozen=True)
class Point:
    """All settings that give a point, and one variant per seed, the scene's own first; None is the scene itself."""

    settings: list[Setting]
    variants: list[str | None]


def read_scenes_with_points(config: Config, presets: Path) -> dict[tuple[str, str], Scene]:
    """Read the table of scenes and add the variants of each scene's points, see ``read_scenes`` and ``with_points``."""
    scenes = read_scenes(config)
    return {
        key: replace(scene, config=with_points(scene.config, presets, scene.format))
        for key, scene in scenes.items()
    }


def measured_points(scene: Scene) -> list[dict[str, Any]]:
    """The points of a scene for ``egosplat tradeoff``: settings, recipe, and the metrics.json of each run."""
    return [
        {
            "settings": [[one.knob, one.value] for one in point.settings],
            "recipe": recipe_of(scene, point.variants[0]),
            "metrics": [
                f"{scene.results}/{variants.variant_folder(variant)}metrics.json"
                for variant in point.variants
            ],
        }
        for point in points_of(scene.config, scene.name)
    ]


def recipe_of(scene: Scene, variant: str | None) -> dict[str, Any]:
    """How to make a scene or one of its variants: ``keys`` that differ from the defaults, by full name, and ``command``."""
    config = variants.variant_config(scene.config, variant, scene.name) if variant else scene.config
    usual = choose_set(defaults(), automatic_set("synthetic" if scene.synthetic else "real"))
    # All points have the recording of the scene.
    sections = {section for stage in STAGES if stage != "synthetic" for section in stage_sections(stage)}
    keys = {
        f"{section}.{key}": value
        for section in config
        if section in sections
        for key, value in config[section].items()
        if value != usual[section][key]
    }
    preset = scene.config["preset"]
    flag = "" if preset == usual["preset"] else f"--config preset={preset} -- "
    target = f"{scene.results}/{variants.variant_folder(variant)}metrics.json"
    return {"keys": keys, "command": f"{snakemake_in(Path())} --cores 2 {flag}{target}"}


def with_points(config: Config, presets: Path, format: str) -> Config:
    """Add the variants of a scene's points to its configuration (UserError: a knob is not valid, or a name is taken)."""
    settings: Config = {}
    for setting in _settings(config):
        name = variant_name(setting)
        if name in settings:
            raise UserError(
                f"tradeoff.sweep: two values of {setting.knob} have the name {name}; remove one of them"
            )
        section, _, key = setting.knob.partition(".")
        if setting.knob == PRESET:
            settings[name] = variants.preset_keys(setting.value, presets, format)
        else:
            settings[name] = {section: {key: setting.value}}
    found = dict(settings)
    for seed in config["tradeoff"]["seeds"]:
        found[f"seed-{seed}"] = {"run": {"seed": seed}}
        found |= {f"{name}-seed-{seed}": {variants.EXTENDS: [name, f"seed-{seed}"]} for name in settings}
    if taken := sorted(set(found) & set(config["variants"])):
        raise UserError(
            f"variants: {taken[0]} is the name of a point of the section tradeoff; rename the variant"
        )
    return config | {"variants": config["variants"] | found}


def points_of(config: Config, where: str) -> list[Point]:
    """The points of a scene: itself, then the others in order (UserError: a value or a seed is not allowed)."""
    seeds = config["tradeoff"]["seeds"]
    for seed in seeds:
        if not variants.reaches("metrics", config, variants.variant_config(config, f"seed-{seed}", where)):
            raise UserError(
                f"{where}: tradeoff.seeds: {seed} is the scene's own seed; give other seeds, or none"
            )
    swept = [key.split(".") for key in config["tradeoff"]["sweep"]]
    own = [Setting(f"{section}.{key}", config[section][key]) for section, key in swept]
    scene = Point(own, [None, *(f"seed-{seed}" for seed in seeds)])
    points = [scene]
    for setting in _settings(config):
        name = variant_name(setting)
        if variants.reaches("metrics", config, variants.variant_config(config, name, where)):
            points.append(Point([setting], [name, *(f"{name}-seed-{seed}" for seed in seeds)]))
        elif setting not in scene.settings:
            scene.settings.append(setting)
    return points


def variant_name(setting: Setting) -> str:
    """The name of a setting's variant, such as ``features-dims-8``; for a preset, the name of the preset."""
    text = shown(setting.value)
    safe = re.sub("[^A-Za-z0-9_-]", "_", text)[:_LONGEST]
    # A hash keeps names unique after characters are replaced: masks-threshold-0_5-d2cbad is 0.5 only.
    if safe != text:
        safe += f"-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
    return safe if setting.knob == PRESET else f"{setting.knob.replace('.', '-')}-{safe}"


def shown(value: Any) -> str:
    """Format a value: text as it is, other values as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def _settings(config: Config) -> Iterator[Setting]:
    about = config["tradeoff"]
    yield from (Setting(PRESET, name) for name in about["presets"])
    for knob, values in about["sweep"].items():
        _check_knob(knob)
        yield from (Setting(knob, value) for value in values)


def _check_knob(knob: str) -> None:
    section, _, key = knob.partition(".")
    known = section_keys(section)
    if key not in known:
        near = difflib.get_close_matches(key, known, n=1)
        advice = f"did you mean {section}.{near[0]}?" if near else "egosplat keys lists all keys"
        raise UserError(f"tradeoff.sweep: no key {knob}; {advice}")
    if section in variants.QUESTIONS or knob in variants.QUESTIONS:
        raise UserError(f"tradeoff.sweep: scores with other values of {knob} cannot be compared; remove it")
    if knob == "run.seed" or section == "tradeoff":
        raise UserError(f"tradeoff.sweep: {knob} cannot be swept; remove it (seeds are in tradeoff.seeds)")
