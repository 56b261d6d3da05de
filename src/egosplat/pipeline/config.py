"""The configuration: layers of keys, merged in order and checked once against the options of all stages.

Of the layers of a scene the later ones win: defaults of the set of models, preset, protocol of the format, the user's keys, the
scene's row, variants. ``dag.decide`` adds what the survey decides.
"""

import functools
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import Field, ValidationError, create_model
from pydantic_core import ErrorDetails

from egosplat.errors import UserError
from egosplat.pipeline.general_options import SHIPPED, GeneralOptions
from egosplat.pipeline.home import find_preset
from egosplat.pipeline.messages import not_allowed, refusal, shorten, shown, unknown_key
from egosplat.pipeline.model_sets import AUTO, DEFAULTS
from egosplat.pipeline.options import Options, keys_of, sections_of
from egosplat.pipeline.stages import PLUGINS, STAGES
from egosplat.pipeline.strict_yaml import parse_value, read_yaml

# A value for each key, by section.
Config = dict[str, Any]

# Options of the sections that no stage has for itself: those of packages beside this one hold for all of a scene.
OF_SCENES = {name: path for plugin in PLUGINS for name, path in plugin.SECTIONS.items()}
_SHARED = OF_SCENES | {
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


# Its protocols replace values of a preset for all scenes.
SHIPPED_LAYER = Layer("protocols", SHIPPED)


class LayeredConfig(Config):
    """A complete configuration, the layers that it is merged from, its variants' by name, as far as they were asked for, and
    the keys of presets as variants, by name, for a set of models."""

    def __init__(self, values: Mapping[str, Any], layers: Sequence[Layer] = ()) -> None:
        super().__init__(values)
        self.layers = tuple(layers)
        self.variants: dict[str, LayeredConfig] = {}
        self.presets: Callable[[str], Mapping[str, Config]] = lambda models: {}


@functools.cache
def stage_options(stage: str) -> type[Options] | None:
    """Get the class of a stage's options; None for a stage without keys."""
    name = STAGES[stage].options
    return pkgutil.resolve_name(name) if name else None


def stage_sections(stage: str) -> dict[str, tuple[str, ...]]:
    """Get the names of the keys that a stage takes, by section."""
    options = stage_options(stage)
    return sections_of(options, stage) if options else {}


def stage_values(stage: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Get the values of a stage's options from a complete configuration, by name."""
    return {key: config[section][key] for section, keys in stage_sections(stage).items() for key in keys}


@functools.cache
def section_options() -> dict[str, type[Options]]:
    """Get the class of options that has the keys of each section."""
    shared: dict[str, Any] = {name: pkgutil.resolve_name(path) for name, path in _SHARED.items()}
    shared |= {stage: stage_options(stage) for stage in STAGES if stage in stage_sections(stage)}
    return shared


@functools.cache
def section_keys(section: str) -> dict[str, dict[str, Any]]:
    """Get the JSON schema of each key of a section, by name; empty if there is no such section."""
    if (options := section_options().get(section)) is None:
        return {}
    keys = keys_of(options)
    return {name: keys[name] for name in sections_of(options, section)[section]}


@functools.cache
def _model() -> type[Options]:
    """The class of all keys: the general ones, and those of each section."""
    sections: dict[str, Any] = {}
    for section, options in section_options().items():
        fields = [(name, options.model_fields[name]) for name in sections_of(options, section)[section]]
        keys: dict[str, Any] = {name: (field.annotation, field) for name, field in fields}
        model = create_model(section, __base__=Options, **keys)
        sections[section] = (model, Field(default_factory=model))
    return create_model("Configuration", __base__=GeneralOptions, **sections)


def configure(layers: Sequence[Layer], automatic: str = AUTO) -> LayeredConfig:
    """Merge layers over the defaults of the set of models that they choose, ``automatic`` by ``auto``, and
    check the values (UserError: a key is wrong; names the last layer that sets it, its value and what is
    allowed)."""
    models = merge_layers(layers).get("models")
    named = models.get("set", AUTO) if isinstance(models, Mapping) else AUTO
    chosen = automatic if named == AUTO else named
    values = merge_layers([Layer(chosen, DEFAULTS.get(str(chosen), {})), *layers])
    try:
        config = LayeredConfig(_model().model_validate(values).as_dict(), layers)
    except ValidationError as error:
        raise _refused(error.errors(include_url=False)[0], values, layers) from None
    if config["splats"]["source"] is not None:
        _check_given_splats(config)
    config["models"]["set"] = chosen
    return config


def merge_layers(layers: Iterable[Layer]) -> Config:
    """Merge keys section by section, later layers over earlier ones; values are not checked."""
    return functools.reduce(lambda values, layer: merge(values, layer.keys, depth=1), layers, {})


def _refused(error: ErrorDetails, values: Config, layers: Sequence[Layer]) -> UserError:
    """Name the layer, the key and its value, and what is allowed."""
    section, *steps = map(str, error["loc"])
    sections, general = section_options(), keys_of(GeneralOptions)
    keys = section_keys(section)
    if section in general:
        told = refusal(error, error["loc"], values, general, {name: name for name in general})
    elif section not in sections:
        homes = [f"{name}.{section}" for name in sections if section in section_keys(name)]
        told = unknown_key(section, section, [*general, *sections], homes)
    elif not steps:
        name, key = next(iter(keys.items()))
        example = f"must be keys with values, as in {section}: {{{name}: {shown(key['default'])}}}"
        told = not_allowed(section, values[section], example)
    else:
        names = {name: f"{section}.{name}" for name in (*keys, steps[0])}
        told = refusal(error, error["loc"][1:], values[section], keys, names)
    return UserError(f"{_setter(layers, *error['loc'][: 1 + (section in sections)])}: {told}")


def _setter(layers: Sequence[Layer], section: Any, key: Any = None) -> str:
    """Say what sets a key: the last layer that has it."""
    for where, keys in reversed(layers):
        if section in keys and (key is None or (isinstance(keys[section], Mapping) and key in keys[section])):
            return where
    return "configuration"


def _check_given_splats(config: LayeredConfig) -> None:
    """Check that nothing is trained or corrected where another program trained the Gaussians."""
    needs = {("splats", "language"): "after"} | {("camera", key): "off" for key in section_keys("camera")}
    for (section, key), needed in needs.items():
        if (given := config[section][key]) not in (needed, AUTO):
            where = _setter(config.layers, "splats", "source")
            told = f"the Gaussians are trained already, which needs {section}.{key} = {needed}, not {given}"
            raise UserError(f"{where}: splats.source: {told}")


def defaults() -> LayeredConfig:
    """Get the default configuration."""
    return configure([SHIPPED_LAYER])


def resolve(user: Mapping[str, Any], presets: Path) -> LayeredConfig:
    """Get the configuration before a scene is chosen: its layers are the preset, a file in ``presets``, the protocols, and the
    user's keys from files and the command line (UserError: names the first wrong key)."""
    asked = Layer("configuration", user)
    path = find_preset(presets, configure([SHIPPED_LAYER, asked])["preset"])
    config = configure([Layer(f"preset {path.name}", read_yaml(path)), SHIPPED_LAYER, asked])
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


def merge(below: Mapping[str, Any], above: Mapping[str, Any], depth: int = 9) -> dict[str, Any]:
    """Merge ``above`` over ``below`` to a depth; what is not merged is shared, so nobody may edit it in place."""
    merged = dict(below)
    for key, value in above.items():
        both = depth and isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value, depth - 1) if both else value
    return merged


def parse_options(text: str, where: str) -> dict[str, Any]:
    """Parse ``frames.stride=2`` and more words to ``{"frames": {"stride": 2}}`` (UserError: one has another form)."""
    options: dict[str, Any] = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        section, dot, name = key.partition(".")
        if not (equals and dot and section and name):
            form = "section.key=value, as in frames.stride=2"
            raise UserError(f"{where}: option {shorten(word)} is not of the form {form}")
        if name in options.setdefault(section, {}):
            raise UserError(f"{where}: option {shorten(key)} is set twice; remove one")
        options[section][name] = parse_value(value, f"{where}: option {shorten(word)}")
    return options
