"""The sets of models: keys whose default follows ``models.set``, and the paths of published checkpoints.

``config.schema.yaml`` has a second default, ``published``, at each key whose best value depends on the model.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from egosplat.pipeline.published import ENCODER, LIBRARIES, PUBLISHED, published_model
from egosplat.pipeline.validation import schema


def set_of(config: Mapping[str, Any]) -> str | None:
    """Get the set that a configuration, complete or not, chooses; None if it chooses none."""
    models = config.get("models")
    return models.get("set") if isinstance(models, Mapping) else None


def default_of(key: Mapping[str, Any], chosen: str | None) -> Any:
    """Get the default of a key, from its part of the schema, with a set of models."""
    return key[PUBLISHED] if chosen == PUBLISHED and PUBLISHED in key else key["default"]


def keys_of_models() -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield section, name and schema of each key whose default follows ``models.set``."""
    for section, part in schema("config")["properties"].items():
        for name, key in part.get("properties", {}).items():
            if PUBLISHED in key:
                yield section, name, key


def switched(config: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the defaults of a configuration's set of models by those of another set.

    A value that differs from the default of its own set was set by somebody, and stays.

    Args:
        config: complete configuration.
        above: keys to be merged over it, of a format, scene or variant, which may choose another set.
    """
    old, new = set_of(config), set_of(above)
    found = dict(config)
    if new in (None, old):
        return found
    for section, name, key in keys_of_models():
        if config[section][name] == default_of(key, old):
            found[section] = found[section] | {name: default_of(key, new)}
    return found


def located(config: Mapping[str, Any]) -> dict[str, Any]:
    """Replace ``published`` in a complete configuration by the path of the file in ``models.cache``.

    Raises:
        UserError: there is no published checkpoint of the configured architecture.
    """
    models = config["models"]
    architectures = dict(zip(LIBRARIES, (models["sam2_config"], models["clip_model"], ENCODER), strict=True))
    found = dict(config)
    for key, architecture in architectures.items():
        section, name = key.split(".")
        if config[section][name] == PUBLISHED:
            path = Path(models["cache"]) / published_model(key, architecture).file
            found[section] = found[section] | {name: str(path)}
    return found
