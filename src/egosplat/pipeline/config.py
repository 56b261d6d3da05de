"""The configuration: defaults, preset, user's keys and scene's keys, checked against one schema."""

import copy
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.pipeline.model_sets import default_of, set_of, switched
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml, problem
from egosplat.pipeline.validation import Draft202012Validator, StrictValidator, explained, schema, shortened

Config = dict[str, Any]

# Value of segments.point_prompts for points by depth.
DEPTH = "depth"

# Sections whose values are named sets of keys.
_NAMED = ("variants", "formats")


def coerced(config: Mapping[str, Any]) -> Config:
    """Convert the strings of a configuration to the types in the schema.

    A string that cannot be converted stays, and validation rejects it.
    """
    # Snakemake passes the 5 of `--config splats={iterations: 5}` and the 1e-4 of a file as strings.
    root = schema("config")
    found = _coerced(config, root)
    sections = {name: part for name, part in root["properties"].items() if name not in _NAMED}
    for named in _NAMED:
        if isinstance(sets := found.get(named), Mapping):
            found[named] = {name: _coerced(keys, {"properties": sections}) for name, keys in sets.items()}
    tradeoff = found.get("tradeoff")
    if isinstance(tradeoff, Mapping) and isinstance(sweep := tradeoff.get("sweep"), Mapping):
        found["tradeoff"] = {**tradeoff, "sweep": {key: _coerced_sweep(key, sweep[key]) for key in sweep}}
    return found


def _coerced_sweep(key: object, values: Any) -> Any:
    """Convert the values of a swept key by the schema of that key."""
    section, _, name = str(key).partition(".")
    part = schema("config")["properties"].get(section, {}).get("properties", {}).get(name, {})
    return _coerced(values, {"type": "array", "items": part})


def _coerced(value: Any, part: Mapping[str, Any]) -> Any:
    if isinstance(value, str):
        return _read(value, part)
    # YAML reads the words on and off as booleans.
    if isinstance(value, bool) and "on" in part.get("enum", ()):
        return "on" if value else "off"
    if isinstance(value, list) and "items" in part:
        return [_coerced(item, part["items"]) for item in value]
    if isinstance(value, Mapping) and part.keys() & {"properties", "additionalProperties"}:
        known, other = part.get("properties", {}), part.get("additionalProperties") or {}
        return {key: _coerced(item, known.get(key, other)) for key, item in value.items()}
    return value


def _read(text: str, part: Mapping[str, Any]) -> Any:
    kinds = part.get("type", "string")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if text == "null" and "null" in kinds:
        return None
    # A key that may be a text keeps it: a file named 5 is not a number.
    if "string" in kinds and re.fullmatch(part.get("pattern", ".*"), text, re.DOTALL):
        return text
    try:
        return load_yaml(text)
    except NO_YAML:
        return text


# Validators of files that people write. JSON artifacts use the standard validator.
_VALIDATORS = {"config": StrictValidator, "scenes": StrictValidator}


def section_keys(section: str) -> dict[str, dict[str, Any]]:
    """Get the schema of each key of a section, by name; empty for a stage without keys."""
    return schema("config")["properties"].get(section, {}).get("properties", {})


def stage_keys(stage: str) -> dict[str, dict[str, Any]]:
    """Get the schema of each key that a stage takes, by name, from its own section and those in its ``Stage``."""
    about = STAGES[stage]
    keys: dict[str, dict[str, Any]] = {}
    for section in (stage, *about.sections):
        keys |= section_keys(section)
    for section, names in about.keys.items():
        keys |= {name: section_keys(section)[name] for name in names}
    return keys


def stage_values(stage: str, config: Mapping[str, Any]) -> Config:
    """Get the values of a stage's keys from a complete configuration."""
    about = STAGES[stage]
    values: Config = {}
    for section in (stage, *about.sections):
        values |= config.get(section, {})
    for section, names in about.keys.items():
        values |= {name: config[section][name] for name in names}
    return values


def defaults() -> Config:
    """Get the default configuration."""
    return _filled({}, schema("config"))


def resolve(user: Mapping[str, Any], presets: Path) -> Config:
    """Merge the user's keys over the preset's, and those over the defaults of the chosen set of models.

    Args:
        user: keys from the configuration files and the command line.
        presets: folder with one file for each preset.

    Raises:
        UserError: a key is unknown or has a forbidden value; names the first one.
    """
    user = coerced(user)
    asked = _filled(user, schema("config"))
    check(asked)
    path = presets / f"{asked['preset']}.yaml"
    preset = read_yaml(path)
    # A key that the user sets for all scenes wins over the preset's value for one format.
    formats = {name: _without(keys, user) for name, keys in preset.get("formats", {}).items()}
    settings = merge(preset | {"formats": formats}, user)
    resolved = _filled(settings, schema("config"), set_of(settings))
    check(resolved, f"preset {path.name}")
    # Keys of a format are checked in the whole: a value may be valid by itself and not with the others.
    for name in resolved["formats"]:
        check(of_format(resolved, name), f"formats.{name}")
    return resolved


def of_format(config: Mapping[str, Any], name: str) -> Config:
    """Get the configuration of scenes with the format ``adt``, ``hoi4d`` or ``plain``."""
    return overlaid(config, config["formats"].get(name, {})) | {"formats": {}}


def overlaid(config: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Merge keys of a format, scene or variant over a complete configuration.

    If they choose another set of models, defaults that belong to the models change with it.
    """
    return merge(switched(config, above), above)


def _without(keys: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Get the keys that ``above`` does not set."""
    return {
        section: {name: value for name, value in part.items() if name not in above.get(section, {})}
        for section, part in keys.items()
    }


def check(values: Mapping[str, Any], where: str = "configuration", against: str = "config") -> None:
    """Check a configuration, or a row of the table of scenes, against the schema of that name.

    Raises:
        UserError: a key is wrong; names the first one, its value and what is allowed.
    """
    validator = _VALIDATORS.get(against, Draft202012Validator)
    for error in validator(schema(against)).iter_errors(values):
        raise UserError(f"{where}: {explained(error)}")
    if values.get("segments", {}).get("point_prompts") == DEPTH:
        _check_prompts(values, where)


def _check_prompts(values: Mapping[str, Any], where: str) -> None:
    # The points come from Gaussians, which must not come from segments in turn. Only single frames have points of
    # their own.
    needs = (
        ("segments", "prompting", "each_frame"),
        ("splats", "masking", "none"),
        ("splats", "language", "after"),
    )
    for section, key, needed in needs:
        if values[section][key] != needed:
            raise UserError(
                f"{where}: segments.point_prompts = {DEPTH} needs {section}.{key} = {needed}, "
                f"not {values[section][key]}; in a variant, extend each_frame"
            )


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Merge ``above`` over ``below``, section by section."""
    merged = copy.deepcopy(dict(below))
    for key, value in above.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if both else copy.deepcopy(value)
    return merged


def parse_options(text: str, where: str) -> Config:
    """Parse ``"frames.stride=2 frames.end_s=20"`` to ``{"frames": {"stride": 2, "end_s": 20}}``.

    Raises:
        UserError: a word has another form, or a key is repeated; ``where`` names the row.
    """
    options: Config = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        section, dot, name = key.partition(".")
        if not (equals and dot and section and name):
            raise UserError(
                f"{where}: option {shortened(word)} is not of the form section.key=value, as in frames.stride=2"
            )
        if name in options.setdefault(section, {}):
            raise UserError(f"{where}: option {shortened(key)} is set twice; remove one")
        options[section][name] = _parsed(value, f"{where}: option {shortened(word)}")
    return coerced(options)


def _parsed(text: str, where: str) -> Any:
    try:
        return load_yaml(text)
    except NO_YAML as error:
        raise UserError(f"{where}: its value cannot be read ({problem(error)})") from None


def read_yaml(path: Path) -> Config:
    """Read a configuration file.

    Raises:
        UserError: the file is missing, is not YAML (names line and column), repeats a key, or is not a mapping.
    """
    try:
        content = load_yaml(path.read_text(encoding="utf-8")) or {}
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist") from None
    except (OSError, *NO_YAML) as error:
        raise UserError(f"{path}: cannot be read as YAML ({problem(error)})") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: holds {type(content).__name__}, needs keys with values")
    return content


def check_config_files(paths: Iterable[Path]) -> None:
    """Check that each configuration file is YAML without repeated keys. Snakemake silently takes the last one.

    Raises:
        UserError: a file is wrong; names the file and the line.
    """
    for path in paths:
        if path.suffix != ".json":
            read_yaml(path)


def _filled(config: Mapping[str, Any], part: Mapping[str, Any], models: str | None = None) -> Config:
    """Add the defaults of a part of the schema, with a set of models."""
    filled = copy.deepcopy(dict(config))
    for key, sub in part.get("properties", {}).items():
        if "default" in sub:
            default = copy.deepcopy(default_of(sub, models))
            filled.setdefault(key, default)
            # A variant of the user stands beside the default ones, and replaces one of its name.
            if key in _NAMED and isinstance(filled[key], Mapping):
                filled[key] = {**default, **filled[key]}
        if isinstance(filled.get(key), Mapping):
            filled[key] = _filled(filled[key], sub, models)
    return filled
