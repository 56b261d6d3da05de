"""Presets as variants of one scene: what each sets over a recording, models and questions that are the scene's own."""

import functools
from collections.abc import Iterator
from pathlib import Path

from egosplat.pipeline.config import Config, of_format, read_yaml, resolve

FILES = {"fast": "fast", "balanced": "balanced", "paper_scaled": "paper"}
"""By name: the preset file that the keys are of."""

QUESTIONS = {
    "synthetic",
    "annotations",
    "metrics",
    "frames.start_s",
    "frames.end_s",
    "frames.evaluation_frames",
    "frames.holdout",
}
"""Sections and keys that decide what is looked at and what is asked: with others, scores could not be compared."""

MODELS = {
    "models",
    "segments.pred_iou_thresh",
    "segments.stability_score_thresh",
    "segments.stability_score_offset",
    "segments.nms_score_thresh",
    "transient.encoder_weights",
    "transient.lr",
}
"""The models, and keys that mean nothing without the models that they were chosen for."""

_KEPT = QUESTIONS | MODELS | {"frames.focal"}
"""What a scene keeps as it has it, whatever the preset."""

_SCALED = {"frames.resolution"}
"""What it keeps beside them where the paper's settings are scaled to its pictures."""


@functools.cache
def preset_keys(name: str, folder: Path, format: str) -> Config:
    """The keys of a preset, as those of a variant.

    All that any preset sets is set, so that nothing of the scene's own preset is left. ``paper_scaled`` is ``paper``
    at the scene's resolution; the paper's compares what moves at the pictures' own size, which follows it.

    Args:
        name: one of ``FILES``.
        folder: of the preset files.
        format: of the scene's recording.

    Raises:
        UserError: a preset file cannot be read, or sets what is not allowed.
    """
    kept = _KEPT | _SCALED if FILES[name] != name else _KEPT
    values = of_format(resolve({"preset": FILES[name]}, folder), format)
    keys: Config = {}
    for file in sorted(set(FILES.values())):
        for section, key in _paths(read_yaml(folder / f"{file}.yaml")):
            if section not in kept and f"{section}.{key}" not in kept:
                keys.setdefault(section, {})[key] = values[section][key]
    return keys


def _paths(preset: Config) -> Iterator[tuple[str, str]]:
    sections = {section: keys for section, keys in preset.items() if section != "formats"}
    of_formats = [part for keys in preset.get("formats", {}).values() for part in keys.items()]
    return ((section, key) for section, keys in [*sections.items(), *of_formats] for key in keys)
