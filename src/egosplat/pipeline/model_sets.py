"""The sets of models: keys whose default follows ``models.set``, and the catalogue of published checkpoints."""

import csv
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from egosplat.errors import UserError, without_secrets

# The sets: egosplat chooses; bundled, for its apartments; words for photographs, from Python packages; fast published ones; the
# paper's. The last is also the value of a checkpoint's key that stands for the published checkpoint of the configured architecture.
AUTO, SMALL, PHOTOS, LIGHT, PUBLISHED = "auto", "small", "photos", "light", "published"

_OF_SMALL: dict[str, dict[str, Any]] = {
    "models": dict.fromkeys(("sam2_config", "sam2_checkpoint", "clip_model", "clip_checkpoint"), SMALL),
    "segments": {"image_size": 512},
    "view_features": {"cut": "hull"},
    "transient": {"encoder_weights": None},
    "query": {"temperature": 10.0, "min_score": 0.7, "size_weight": 0.25},
}
_OF_PHOTOS = {"min_score": 0.62, "size_weight": 0.0, "box_filter": 0.12, "present_share": 0.55}
_OF_THE_PAPER = {"sam2_config": "sam2.1_hiera_b+", "clip_model": "ViT-B-16"}

# Defaults by set of models, of each key whose best value depends on the model. Those of ``small`` are the options' own, too.
DEFAULTS: dict[str, dict[str, dict[str, Any]]] = {
    AUTO: _OF_SMALL,
    SMALL: _OF_SMALL,
    PHOTOS: _OF_SMALL
    | {
        "models": dict.fromkeys(_OF_SMALL["models"], PHOTOS) | {"sam2_config": SMALL},
        "segments": _OF_SMALL["segments"] | {"crops_per_side": 1},
        "query": _OF_SMALL["query"] | _OF_PHOTOS,
    },
    PUBLISHED: {
        "models": _OF_THE_PAPER | dict.fromkeys(("sam2_checkpoint", "clip_checkpoint"), PUBLISHED),
        "segments": {"image_size": None},
        "view_features": {"cut": "mask"},
        "transient": {"encoder_weights": PUBLISHED},
        "query": {"temperature": 1.0, "min_score": 0.0, "size_weight": 0.0},
    },
}
# Fast published models for recordings; a crop would take SAM2 as long as a frame (docs/models.md#light). By OpenCLIP's table, this one
# classifies 72.8 % of ImageNet, and ViT-B-16 of LAION-2B 70.2 % in three times the time.
DEFAULTS[LIGHT] = DEFAULTS[PUBLISHED] | {
    "models": DEFAULTS[PUBLISHED]["models"] | {"sam2_config": "sam2.1_hiera_t", "clip_model": "ViT-B-32-256"},
    "segments": {"image_size": None, "crops_per_side": 1},
    "transient": {"encoder_weights": None},
}

# The library of each key that takes ``published``.
LIBRARIES = {
    "models.sam2_checkpoint": "SAM2",
    "models.clip_checkpoint": "OpenCLIP",
    "transient.encoder_weights": "timm",
}

# The transient network's encoder; no key names it.
ENCODER = "mobilenetv3_small_050"


class PublishedModel(NamedTuple):
    """A checkpoint that its authors publish, by the library that loads it and the architecture's name there."""

    library: str
    architecture: str
    weights: str  # the authors' name
    file: str  # name in the folder ``models.cache``
    repository: str  # on the Hugging Face hub; a data set's begins with datasets/
    remote: str  # file there
    revision: str
    license: str  # of the weights
    megabytes: float  # size of the file [10^6 bytes], rounded
    sha256: str | None  # None if no digest is published

    @property
    def on_hub(self) -> dict[str, Any]:
        """The file as functions of ``huggingface_hub`` take it."""
        name = self.repository.removeprefix("datasets/")
        kind = "model" if name == self.repository else "dataset"
        return {"repo_id": name, "filename": self.remote, "revision": self.revision, "repo_type": kind}

    @property
    def address(self) -> str:
        """Where the file is fetched from, without a password."""
        return without_secrets(f"{hub()}/{self.repository}/resolve/{self.revision}/{self.remote}")


# The digests of SAM2.1 are those of the same files on Meta's server; the others are on the files' pages of the hub. No digest
# of the DataComp weights was found.
_TABLE = Path(__file__).with_name("published.tsv").read_text(encoding="utf-8")
CATALOGUE = [
    PublishedModel._make([*names, float(megabytes), sha256 or None])
    for *names, megabytes, sha256 in [*csv.reader(_TABLE.splitlines(), delimiter="\t")][1:]
]


def hub() -> str:
    """Get the address of the Hugging Face hub, or of its mirror if the environment variable HF_ENDPOINT names one."""
    return os.environ.get("HF_ENDPOINT", "").rstrip("/") or "https://huggingface.co"


def named_model(name: str) -> PublishedModel:
    """Get a checkpoint by its architecture or file name (UserError: the catalogue has none of that name)."""
    for model in CATALOGUE:
        if name in (model.architecture, model.file):
            return model
    names = ", ".join(model.architecture for model in CATALOGUE)
    raise UserError(f"{name[:80]}: is not in the catalogue, which has {names}")


def locate_checkpoints(config: Mapping[str, Any]) -> dict[str, Any]:
    """Replace ``published`` by the path of the file in ``models.cache`` (UserError: the catalogue has none)."""
    models, located = config["models"], dict(config)
    architectures = (models["sam2_config"], models["clip_model"], ENCODER)
    for (key, library), architecture in zip(LIBRARIES.items(), architectures, strict=True):
        section, name = key.split(".")
        if config[section][name] != PUBLISHED:
            continue
        files = {model.architecture: model.file for model in CATALOGUE if model.library == library}
        file = files.get(architecture.removesuffix(".yaml").rpartition("/")[2])
        if file is None:
            advice = f"Set {key} to a file, or take an architecture of {', '.join(files)}"
            raise UserError(f"{key} = published: the catalogue has no {architecture!r}. {advice}")
        located[section] = located[section] | {name: str(Path(models["cache"]) / file)}
    return located
