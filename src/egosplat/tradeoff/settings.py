"""The keys of a point that other scenes can take: all but models, questions, seeds and what trades nothing."""

from egosplat.config import Config, schema
from egosplat.tradeoff.presets import MODELS, QUESTIONS

_NO_SETTINGS = {"seed", "backend", "checkpoint_s"}
"""Keys, of any section, that trade neither speed nor accuracy."""

_NO_STAGES = {"budget", "tradeoff"}
"""Sections that no stage reads."""


def settings_of(config: Config) -> Config:
    """These keys of a configuration; those of models, and what goes with them, only where points differ in them."""
    swept = set(config["tradeoff"]["knobs"])
    found: Config = {}
    for section, part in schema("config")["properties"].items():
        for key in part.get("properties", {}):
            if f"{section}.{key}" in swept or _is_setting(section, key):
                found.setdefault(section, {})[key] = config[section][key]
    return found


def differing(above: Config, below: Config) -> Config:
    """The keys of ``above`` that have another value than in ``below``, which has the same keys."""
    found: Config = {}
    for section, keys in above.items():
        if changed := {key: value for key, value in keys.items() if value != below[section][key]}:
            found[section] = changed
    return found


def _is_setting(section: str, key: str) -> bool:
    kept = QUESTIONS | MODELS | _NO_STAGES
    return not (section in kept or f"{section}.{key}" in kept or key in _NO_SETTINGS)
