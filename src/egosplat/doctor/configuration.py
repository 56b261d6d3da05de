"""Read the configuration as the workflow reads it."""

from collections.abc import Sequence
from pathlib import Path

import egosplat
from egosplat.errors import UserError
from egosplat.pipeline.config import Config, merge, read_yaml, resolve
from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml

SHIPPED = Path("config/config.yaml")
"""The file that the workflow reads first, relative to the working directory."""

PRESETS = Path("config/presets")


def read_configuration(files: Sequence[Path], options: Sequence[str]) -> tuple[Config, list[str]]:
    """The whole configuration that Snakemake makes of the same options, and its sources.

    Args:
        files: of ``--configfile``; later ones override earlier ones, all override config/config.yaml.
        options: of ``--config``, as ``preset=fast``, ``models={device: cpu}`` or ``models.device=cpu``; they
            override the files.

    Raises:
        UserError: a file or an option cannot be read, or a key or value is not allowed.
    """
    read = [path for path in (SHIPPED, *files) if path in files or path.is_file()]
    config: Config = {}
    for path in read:
        config = merge(config, read_yaml(path))
    for option in options:
        config = merge(config, _parsed(option))
    return resolve(config, _presets()), [*map(str, read), *options]


def _parsed(option: str) -> Config:
    key, equals, value = option.partition("=")
    try:
        content = load_yaml(value)
    except NO_YAML:
        content = None
    names = key.split(".")  # models.device=cpu is short for models={device: cpu}
    if not (equals and all(names)) or (content is None and value != "null"):
        raise UserError(
            f"--config {option[:80]}: not of the form KEY=VALUE, as in preset=fast or splats.iterations=5"
        )
    for name in reversed(names):
        content = {name: content}
    return content


def _presets() -> Path:
    """The presets of the working directory, else those of the source tree."""
    return PRESETS if PRESETS.is_dir() else Path(egosplat.__file__).resolve().parents[2] / PRESETS
