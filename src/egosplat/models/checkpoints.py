"""Find the checkpoints of SAM2 and OpenCLIP and hash their content, without importing the models' libraries."""

import contextlib
import functools
import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from egosplat.errors import UserError
from egosplat.files import expand_home
from egosplat.models.configs import (
    PHOTO_WEIGHTS,
    PHOTOS,
    SMALL,
    SMALL_CLIP,
    SMALL_SAM2,
    clip_config_files,
    sam2_config_file,
)

# Replaces the hash of a missing model, so that only the stage that needs it reports the error.
MISSING = "missing"

# Advice for a missing file. The command takes the same --config and --configfile as the doctor.
FETCH = "Fetch published checkpoints with egosplat models download (egosplat models lists their addresses)"


@dataclass(frozen=True)
class ModelSpec:
    """A pretrained model that egosplat uses.

    Attributes:
        config_key, checkpoint_key: keys of the configuration's section ``models``.
        small: path of the packaged small checkpoint.
    """

    name: str
    config_key: str
    checkpoint_key: str
    small: Path


SAM2 = ModelSpec("SAM2", "sam2_config", "sam2_checkpoint", SMALL_SAM2.parent / "model.safetensors")

CLIP = ModelSpec("OpenCLIP", "clip_model", "clip_checkpoint", SMALL_CLIP / "open_clip_model.safetensors")


def find_checkpoint(model: ModelSpec, checkpoint: str) -> Path:
    """The file of a checkpoint: a path, ``small`` for the bundled one, or OpenCLIP's ``photos`` of a Python package.

    Raises:
        UserError: the file is missing. The message names the command that fetches published ones, and the key.
    """
    if model is CLIP and checkpoint == PHOTOS:
        return PHOTO_WEIGHTS.find()
    if checkpoint == SMALL:
        if not model.small.is_file():
            raise UserError(
                f"models.{model.checkpoint_key}: there is no small {model.name} checkpoint {model.small}.\n"
                "It is part of egosplat: install egosplat again, or set the key to another file"
            )
        return model.small
    path = expand_home(checkpoint)
    if not os.path.isfile(path):  # Path.is_file raises for some strings, such as too long ones
        raise UserError(
            f"models.{model.checkpoint_key}: there is no file {path}.\n{FETCH}, or set in config/config.yaml  "
            f"models: {{{model.checkpoint_key}: PATH}}"
        )
    return path


def content_hash(path: Path) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits; cached while its size and modification time are unchanged."""
    stat = path.stat()
    return _sha256(path, stat.st_size, stat.st_mtime_ns)


def joint_hash(files: Iterable[Path]) -> str:
    """Hash of the content of files in their order, 16 hexadecimal digits."""
    return hashlib.sha256(" ".join(map(content_hash, files)).encode()).hexdigest()[:16]


def model_hash(model: ModelSpec, models: Mapping[str, str]) -> str:
    """Hash of a checkpoint and the files of its architecture, 16 hexadecimal digits; UserError if one is missing."""
    checkpoint = find_checkpoint(model, models[model.checkpoint_key])
    # The weights alone do not determine the results: the architecture's files count, too.
    config = models[model.config_key]
    files = [sam2_config_file(config)] if model is SAM2 else clip_config_files(config)
    described = map(_description_hash, files)
    return hashlib.sha256(" ".join([content_hash(checkpoint), *described]).encode()).hexdigest()[:16]


def _description_hash(path: Path) -> str:
    """Hash of a file that describes an architecture; of YAML without comments and layout."""
    try:
        if path.suffix != ".yaml":
            return content_hash(path)
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError, RecursionError):  # the stage reports it
        return content_hash(path)
    return hashlib.sha256(repr(document).encode()).hexdigest()


def model_hashes(config: Mapping[str, Any]) -> dict[str, str]:
    """The hash of each model by the key of its checkpoint; ``missing`` for a model that is missing.

    The rules that use a model have its hash as a parameter: another content makes their results stale.
    """
    found = {model.checkpoint_key: MISSING for model in (SAM2, CLIP)}
    for model in (SAM2, CLIP):
        with contextlib.suppress(UserError):
            found[model.checkpoint_key] = model_hash(model, config["models"])
    return found


@functools.cache
def _sha256(path: Path, size: int, mtime_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
