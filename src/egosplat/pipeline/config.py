"""The configuration: defaults, preset, user's keys and scene's keys, checked against the options of all stages."""

import functools
import pkgutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import read_user_text
from egosplat.pipeline.general_options import PROTOCOLS, VARIANTS, GeneralOptions
from egosplat.pipeline.messages import make_options, not_allowed, shorten, shown, unknown_key
from egosplat.pipeline.model_sets import AUTO, DEFAULTS, PHOTOS, choose_set, name_set, set_of, switch_models
from egosplat.pipeline.options import Options, keys_of, sections_of
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml, problem

Config = dict[str, Any]

# Options of the sections that no stage has for itself.
_SHARED = {
    "tables": "egosplat.pipeline.general_options:TablesOptions",
    "tradeoff": "egosplat.pipeline.general_options:TradeoffOptions",
    "run": "egosplat.pipeline.shared_options:RunOptions",
    "models": "egosplat.pipeline.shared_options:ModelsOptions",
    "camera": "egosplat.pipeline.shared_options:CameraOptions",
    "query": "egosplat.query.options:QueryOptions",
    "presence": "egosplat.evaluation.options:PresenceOptions",
}


@functools.cache
def stage_options(stage: str) -> type[Options] | None:
    """Get the class of a stage's options; None for a stage without keys."""
    name = STAGES[stage].options
    return pkgutil.resolve_name(name) if name else None


@functools.cache
def section_options() -> dict[str, type[Options]]:
    """Get the class of options that has the keys of each section."""
    of_stages = {
        stage: options
        for stage in STAGES
        if (options := stage_options(stage)) and stage in sections_of(options, stage)
    }
    return {name: pkgutil.resolve_name(path) for name, path in _SHARED.items()} | of_stages


@functools.cache
def section_keys(section: str) -> dict[str, dict[str, Any]]:
    """Get the JSON schema of each key of a section, by name; empty if there is no such section."""
    if (options := section_options().get(section)) is None:
        return {}
    keys = keys_of(options)
    return {name: keys[name] for name in sections_of(options, section)[section]}


def stage_sections(stage: str) -> dict[str, tuple[str, ...]]:
    """Get the names of the keys that a stage takes, by section."""
    options = stage_options(stage)
    return sections_of(options, stage) if options else {}


def stage_values(stage: str, config: Mapping[str, Any]) -> Config:
    """Get the values of a stage's options from a complete configuration, by name."""
    return {key: config[section][key] for section, keys in stage_sections(stage).items() for key in keys}


def options_of(stage: str, config: Mapping[str, Any]) -> Options | None:
    """Make a stage's options from a complete configuration; None for a stage without keys."""
    options = stage_options(stage)
    return options and options.model_validate(stage_values(stage, config))


def validate(values: Mapping[str, Any], where: str = "configuration") -> Config:
    """Check a configuration, and add the defaults of the keys that it lacks.

    Raises:
        UserError: a key is wrong; names the first one, its value and what is allowed.
    """
    sections, general = section_options(), keys_of(GeneralOptions)
    for key in values:
        if key not in sections and key not in general:
            homes = [f"{name}.{key}" for name in sections if key in section_keys(name)]
            raise UserError(f"{where}: {unknown_key('', key, [*general, *sections], homes)}")
    own = {key: value for key, value in values.items() if key in general}
    found = make_options(GeneralOptions, own, where, "").as_dict()
    found |= {name: _section(name, values.get(name, {}), where) for name in sections}
    if found["splats"]["source"] is not None:
        needs = {("splats", "language"): ("after",)}
        needs |= {("camera", key): ("off", "auto") for key in keys_of(sections["camera"])}
        _check_needs(found, needs, f"{where}: splats.source: the Gaussians are trained already, which")
    return found


def _check_needs(values: Config, needs: Mapping[tuple[str, str], tuple[str, ...]], what: str) -> None:
    """Check that keys have a value that another one needs."""
    for (section, key), allowed in needs.items():
        if (given := values[section][key]) not in allowed:
            raise UserError(f"{what} needs {section}.{key} = {allowed[0]}, not {given}")


def _section(name: str, values: Any, where: str) -> Config:
    """Check a section, and add its defaults."""
    keys = section_keys(name)
    if not isinstance(values, Mapping):
        first, key = next(iter(keys.items()))
        why = f"must be keys with values, as in {name}: {{{first}: {shown(key['default'])}}}"
        raise UserError(f"{where}: {not_allowed(name, values, why)}")
    for key in values:
        if key not in keys:
            raise UserError(f"{where}: {unknown_key(name, key, list(keys))}")
    found = make_options(section_options()[name], values, where, name).as_dict()
    return {key: found[key] for key in keys}


def defaults() -> Config:
    """Get the default configuration."""
    return validate({"variants": VARIANTS})


def resolve(user: Mapping[str, Any], presets: Path) -> Config:
    """Merge the user's keys over the preset's, and those over the defaults of the chosen set of models.

    Args:
        user: keys from the configuration files and the command line.
        presets: folder with one file for each preset.

    Raises:
        UserError: a key is unknown or has a forbidden value; names the first one.
    """
    asked = validate(user)
    user = _only(asked, user)
    path = presets / f"{asked['preset']}.yaml"
    preset = read_yaml(path)
    # A key that the user sets for all scenes wins over the value of a preset or protocol for one format.
    below = merge(PROTOCOLS, preset.get("formats", {}))
    formats = {name: _without(keys, user) for name, keys in below.items()}
    settings = merge(preset | {"formats": formats}, user)
    if set_of(settings) in (None, AUTO):
        _check_automatic(settings)
    # A variant of the user stands beside the default ones, and replaces one of its name.
    settings["variants"] = {**VARIANTS, **asked["variants"]}
    resolved = validate(merge(DEFAULTS.get(set_of(settings), {}), settings), f"preset {path.name}")
    # Keys of a format are checked in the whole: a value may be valid by itself and not with the others.
    for name in resolved["formats"]:
        validate(of_format(resolved, name), f"formats.{name}")
    return resolved


def _check_automatic(settings: Mapping[str, Any]) -> None:
    """Check that no key has the value of the small models where recordings take another: it would be lost there."""
    for section, keys in DEFAULTS[PHOTOS].items():
        for name, value in keys.items():
            given = settings.get(section, {}).get(name)
            if given == DEFAULTS[AUTO][section][name] != value:
                raise UserError(
                    f"configuration: {section}.{name} = {shown(given)} is for the small models, and recordings take "
                    f"{shown(value)} by themselves. Set models.set, too: small or {PHOTOS} (docs/models.md)"
                )


def of_format(config: Mapping[str, Any], name: str) -> Config:
    """Get the configuration of scenes of a format."""
    return overlaid(config, config["formats"].get(name, {})) | {"formats": {}}


def of_scene(config: Mapping[str, Any], format: str, options: Mapping[str, Any], automatic: str) -> Config:
    """Get the configuration of a scene with a row, for which ``auto`` is another set of models; ``validate`` checks it."""
    # Before keys of format and row are merged: those win over the defaults of the set.
    formats = {name: name_set(keys, automatic) for name, keys in config["formats"].items()}
    chosen = choose_set(config, automatic) | {"formats": formats}
    return overlaid(of_format(chosen, format), name_set(options, automatic))


def overlaid(config: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Merge keys of a format, scene or variant, and of the set of models that they choose, over a complete configuration."""
    return merge(switch_models(config, above), above)


def _only(config: Mapping[str, Any], given: Mapping[str, Any]) -> Config:
    """Get the keys of a complete configuration that are given."""
    return {
        name: {key: config[name][key] for key in part} if name in section_options() else config[name]
        for name, part in given.items()
    }


def _without(keys: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Get the keys that ``above`` does not set."""
    return {
        section: {name: value for name, value in part.items() if name not in above.get(section, {})}
        for section, part in keys.items()
    }


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> Config:
    """Merge ``above`` over ``below``, section by section; what is not merged is shared, so nobody may edit it in place."""
    merged = dict(below)
    for key, value in above.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def parse_options(text: str, where: str) -> Config:
    """Parse ``frames.stride=2`` and more words to ``{"frames": {"stride": 2}}`` (UserError: one has another form)."""
    options: Config = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        section, dot, name = key.partition(".")
        if not (equals and dot and section and name):
            raise UserError(
                f"{where}: option {shorten(word)} is not of the form section.key=value, as in frames.stride=2"
            )
        if name in options.setdefault(section, {}):
            raise UserError(f"{where}: option {shorten(key)} is set twice; remove one")
        options[section][name] = parse_value(value, f"{where}: option {shorten(word)}")
    return options


def parse_value(text: str, where: str) -> Any:
    """Parse a value as YAML (UserError: it is not YAML)."""
    try:
        return load_yaml(text)
    except NO_YAML as error:
        raise UserError(f"{where}: its value cannot be read ({problem(error)})") from None


def read_yaml(path: Path) -> Config:
    """Read a configuration file.

    Raises:
        UserError: the file is missing, is a pipe, is neither JSON nor YAML (names line and column), repeats a key, or is
            not a mapping.
    """
    try:
        content = load_yaml(read_user_text(path))
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Give the path of a configuration file") from None
    except NO_YAML as error:
        raise UserError(f"{path}: cannot be read as YAML ({problem(error)})") from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise UserError(f"{path}: holds {type(content).__name__}, needs keys with values")
    return content


def check_config_files(paths: Iterable[Path]) -> None:
    """Check that each configuration file can be read and repeats no key: Snakemake silently takes the last one."""
    for path in paths:
        read_yaml(path)
