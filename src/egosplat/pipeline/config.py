"""The configuration: layers of keys, merged in order and checked once against the options of all stages.

Of the layers of a scene the later ones win: defaults of the set of models, preset, protocol of the format, the user's keys, the
scene's row, variants. ``dag.decide`` adds what the survey decides.
"""

import functools
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from egosplat.errors import UserError
from egosplat.pipeline.general_options import PROTOCOLS, VARIANTS, GeneralOptions
from egosplat.pipeline.messages import not_allowed, refusal, shorten, shown, unknown_key
from egosplat.pipeline.model_sets import AUTO, DEFAULTS
from egosplat.pipeline.options import Options, keys_of, sections_of
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.strict_yaml import parse_value, read_yaml

# A value for each key, by section.
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


class Layer(NamedTuple):
    """Keys by section, and what sets them, for messages."""

    where: str
    keys: Mapping[str, Any]


class LayeredConfig(Config):
    """A complete configuration, and the layers that it is merged from.

    Attributes:
        layers: what it is merged from; later ones win.
        variants: complete configurations of variants by name, as far as they were asked for.
    """

    def __init__(self, values: Mapping[str, Any], layers: Sequence[Layer] = ()) -> None:
        super().__init__(values)
        self.layers = tuple(layers)
        self.variants: dict[str, LayeredConfig] = {}


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


def stage_values(stage: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Get the values of a stage's options from a complete configuration, by name."""
    return {key: config[section][key] for section, keys in stage_sections(stage).items() for key in keys}


def configure(layers: Sequence[Layer], automatic: str = AUTO) -> LayeredConfig:
    """Merge layers over the defaults of the set of models that they choose, and check the values.

    Args:
        automatic: the set that they choose with ``auto``, or by naming none.

    Raises:
        UserError: a key is wrong; names the last layer that sets it, its value and what is allowed.
    """
    chosen = _chosen_set(layers) or automatic
    values = merge_layers([Layer(chosen, DEFAULTS.get(chosen, {})), *layers])
    config = LayeredConfig(_checked(values, layers), layers)
    config["models"]["set"] = chosen
    return config


def merge_layers(layers: Iterable[Layer]) -> Config:
    """Merge keys section by section, later layers over earlier ones; values are not checked."""
    values: Config = {}
    for section, above in (item for layer in layers for item in layer.keys.items()):
        below = values.get(section)
        if isinstance(below, Mapping) and isinstance(above, Mapping):
            above = {**below, **above}
        values[section] = above
    return values


def _chosen_set(layers: Sequence[Layer]) -> str | None:
    """Get the set of models that the last layer with one chooses; None for ``auto``."""
    models = [layer.keys["models"] for layer in layers if isinstance(layer.keys.get("models"), Mapping)]
    named = [keys["set"] for keys in models if "set" in keys]
    return named[-1] if named and isinstance(named[-1], str) and named[-1] != AUTO else None


def _checked(values: Mapping[str, Any], layers: Sequence[Layer]) -> dict[str, Any]:
    """Check merged values, and add the defaults of the keys that they lack."""
    sections, general = section_options(), keys_of(GeneralOptions)
    for key in values:
        if key not in sections and key not in general:
            homes = [f"{name}.{key}" for name in sections if key in section_keys(name)]
            raise UserError(f"{_setter(layers, key)}: {unknown_key('', key, [*general, *sections], homes)}")
    own = {key: value for key, value in values.items() if key in general}
    found = _options(GeneralOptions, own, layers, "")
    found |= {name: _section(name, values.get(name, {}), layers) for name in sections}
    if found["splats"]["source"] is not None:
        _check_given_splats(found, layers)
    return found


def _section(name: str, values: Any, layers: Sequence[Layer]) -> dict[str, Any]:
    """Check a section, and add its defaults."""
    keys = section_keys(name)
    if not isinstance(values, Mapping):
        first, key = next(iter(keys.items()))
        why = f"must be keys with values, as in {name}: {{{first}: {shown(key['default'])}}}"
        raise UserError(f"{_setter(layers, name)}: {not_allowed(name, values, why)}")
    for key in values:
        if key not in keys:
            raise UserError(f"{_setter(layers, name, key)}: {unknown_key(name, key, list(keys))}")
    found = _options(section_options()[name], values, layers, name)
    return {key: found[key] for key in keys}


def _options(
    options: type[Options], values: Mapping[str, Any], layers: Sequence[Layer], section: str
) -> dict[str, Any]:
    """Make options of a section, which checks the values and adds the defaults."""
    try:
        return options.model_validate(values).as_dict()
    except ValidationError as error:
        key = error.errors(include_url=False)[0]["loc"][0]
        where = _setter(layers, section, key) if section else _setter(layers, key)
        raise UserError(f"{where}: {refusal(error, values, options, section)}") from None


def _setter(layers: Sequence[Layer], section: Any, key: Any = None) -> str:
    """Say what sets a key: the last layer that has it."""
    for where, keys in reversed(layers):
        if section in keys and (key is None or (isinstance(keys[section], Mapping) and key in keys[section])):
            return where
    return "configuration"


def _check_given_splats(values: Mapping[str, Any], layers: Sequence[Layer]) -> None:
    """Check that nothing is trained or corrected where another program trained the Gaussians."""
    needs = {("splats", "language"): ("after",)}
    needs |= {("camera", key): ("off", "auto") for key in section_keys("camera")}
    for (section, key), allowed in needs.items():
        if (given := values[section][key]) not in allowed:
            raise UserError(
                f"{_setter(layers, 'splats', 'source')}: splats.source: the Gaussians are trained already, which needs "
                f"{section}.{key} = {allowed[0]}, not {given}"
            )


# Its protocols replace values of a preset for all scenes.
SHIPPED = Layer("protocols", {"formats": PROTOCOLS, "variants": VARIANTS})


def defaults() -> LayeredConfig:
    """Get the default configuration."""
    return configure([SHIPPED])


def resolve(user: Mapping[str, Any], presets: Path) -> LayeredConfig:
    """Get the configuration before a scene is chosen: its layers are the preset, the protocols and the user's keys.

    Args:
        user: keys from the configuration files and the command line.
        presets: folder with one file for each preset.

    Raises:
        UserError: a key is unknown or has a forbidden value; names the first one.
    """
    asked = Layer("configuration", user)
    general = {key: value for key, value in user.items() if key in keys_of(GeneralOptions)}
    preset = _options(GeneralOptions, general, [asked], "")["preset"]
    path = presets / f"{preset}.yaml"
    config = configure([Layer(f"preset {path.name}", read_yaml(path)), SHIPPED, asked])
    # A format that no scene of the table has is checked, too.
    for format in user.get("formats", {}):
        of_format(config, format)
    return config


def of_format(config: LayeredConfig, format: str, *above: Layer, automatic: str = AUTO) -> LayeredConfig:
    """Get the configuration of scenes of a format, with layers above; ``automatic`` as in ``configure``."""
    return configure([*layers_of_format(config.layers, format), *above], automatic)


def layers_of_format(layers: Iterable[Layer], format: str) -> Iterator[Layer]:
    """Put the keys that a layer has for scenes of a format above its keys for all scenes."""
    for where, keys in layers:
        yield Layer(where, {section: values for section, values in keys.items() if section != "formats"})
        if special := keys.get("formats", {}).get(format):
            yield Layer(f"formats.{format}", special)


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Merge ``above`` over ``below``, section by section; what is not merged is shared, so nobody may edit it in place."""
    merged = dict(below)
    for key, value in above.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def parse_options(text: str, where: str) -> dict[str, Any]:
    """Parse ``frames.stride=2`` and more words to ``{"frames": {"stride": 2}}`` (UserError: one has another form)."""
    options: dict[str, Any] = {}
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
