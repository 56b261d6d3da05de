"""The sets of models: keys whose default follows ``models.set``, and the paths of published checkpoints."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from egosplat.pipeline.published import ENCODER, LIBRARIES, PUBLISHED, published_model
from egosplat.pipeline.recording_origin import Origin

# The sets: egosplat chooses; bundled, for its apartments; words for photographs, from Python packages.
AUTO, SMALL, PHOTOS = "auto", "small", "photos"

_OF_SMALL: dict[str, dict[str, Any]] = {
    "models": dict.fromkeys(("sam2_config", "sam2_checkpoint", "clip_model", "clip_checkpoint"), SMALL),
    "segments": {"image_size": 512},
    "view_features": {"cut": "hull"},
    "features": {"mismatched_views": "keep_own"},
    "transient": {"encoder_weights": None},
    "query": {"temperature": 10.0, "min_score": 0.78},
}

# Defaults by set of models, of each key whose best value depends on the model. Those of ``small`` are the defaults of the
# options, too; those of ``published`` are the paper's or LangSplat's; ``photos`` finds masks with the small SAM2.
DEFAULTS: dict[str, dict[str, dict[str, Any]]] = {
    AUTO: _OF_SMALL,
    SMALL: _OF_SMALL,
    PHOTOS: _OF_SMALL
    | {
        "models": _OF_SMALL["models"] | {"clip_model": PHOTOS, "clip_checkpoint": PHOTOS},
        "query": {"temperature": 10.0, "min_score": 0.62},
    },
    PUBLISHED: {
        "models": {
            "sam2_config": "sam2.1_hiera_b+",
            "sam2_checkpoint": PUBLISHED,
            "clip_model": "ViT-B-16",
            "clip_checkpoint": PUBLISHED,
        },
        "segments": {"image_size": None},
        "view_features": {"cut": "mask"},
        "features": {"mismatched_views": "average"},
        "transient": {"encoder_weights": PUBLISHED},
        "query": {"temperature": 1.0, "min_score": 0.0},
    },
}


def automatic_set(origin: Origin) -> str:
    """Choose the set for a recording: the small models know only what egosplat renders."""
    return SMALL if origin == "synthetic" else PHOTOS


def locate_checkpoints(config: Mapping[str, Any]) -> dict[str, Any]:
    """Replace ``published`` by the path of the file in ``models.cache`` (UserError: the catalogue has none)."""
    models = config["models"]
    architectures = dict(zip(LIBRARIES, (models["sam2_config"], models["clip_model"], ENCODER), strict=True))
    found = dict(config)
    for key, architecture in architectures.items():
        section, name = key.split(".")
        if config[section][name] == PUBLISHED:
            path = Path(models["cache"]) / published_model(key, architecture).file
            found[section] = found[section] | {name: str(path)}
    return found
