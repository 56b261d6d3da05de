"""Presets as variants of a scene, with the scene's own recording, models and queries."""

import functools
from collections.abc import Iterator
from pathlib import Path

from egosplat.pipeline.config import Config, of_format, read_yaml, resolve
from egosplat.pipeline.model_sets import DEFAULTS
from egosplat.pipeline.published import PUBLISHED

# Preset file by name of the variant.
FILES = {name: name for name in ("draft", "fast", "balanced", "accurate")} | {"paper_scaled": "paper"}

# Sections and keys that define frames and queries. Scores with different values cannot be compared.
QUESTIONS = {
    "synthetic",
    "annotations",
    "metrics",
    "frames.start_s",
    "frames.end_s",
    "frames.evaluation_frames",
    "frames.holdout",
}

# Sections and keys that keep the scene's value with every preset.
# No preset sets a key whose default follows models.set; transient.lr suits the scene's encoder.
_KEPT = QUESTIONS | {"models", "transient.lr", "frames.focal"}

# Further keys that keep the scene's value with ``paper_scaled``.
_SCALED = {"frames.resolution"}

# Sections in which what comes with the paper's models is the paper's reading, which other models can follow.
_OF_THE_PAPER = ("view_features", "features", "query")


@functools.cache
def preset_keys(name: str, folder: Path, format: str) -> Config:
    """Get the keys of a preset as those of a variant. ``paper_scaled`` is ``paper`` at the scene's resolution and models.

    Args:
        name: one of ``FILES``.
        folder: of the preset files.
        format: of the scene's recording.

    Raises:
        UserError: a preset file cannot be read or sets a forbidden value.
    """
    kept = _KEPT | _SCALED if FILES[name] != name else _KEPT
    values = of_format(_resolved(FILES[name], folder), format)
    # Set every key that any preset sets, so that no value of the scene's own preset remains.
    keys: Config = {}
    for section, key in _set_by_presets(folder):
        if section not in kept and f"{section}.{key}" not in kept:
            keys.setdefault(section, {})[key] = values[section][key]
    if FILES[name] == "paper":
        for section in _OF_THE_PAPER:
            keys[section] = keys.get(section, {}) | DEFAULTS[PUBLISHED][section]
    return keys


@functools.cache
def _resolved(preset: str, folder: Path) -> Config:
    return resolve({"preset": preset}, folder)


@functools.cache
def _set_by_presets(folder: Path) -> list[tuple[str, str]]:
    """The section and name of each key that a preset sets."""
    files = sorted(set(FILES.values()))
    return [path for file in files for path in _paths(read_yaml(folder / f"{file}.yaml"))]


def _paths(preset: Config) -> Iterator[tuple[str, str]]:
    sections = {section: keys for section, keys in preset.items() if section != "formats"}
    of_formats = [part for keys in preset.get("formats", {}).values() for part in keys.items()]
    return ((section, key) for section, keys in [*sections.items(), *of_formats] for key in keys)
