"""A tiny OpenCLIP with random weights, as files."""

import gzip
import json
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file

from egosplat.models.open_clip_loader import build_model

DESCRIPTION: dict[str, Any] = {
    "model_cfg": {
        "embed_dim": 8,
        "vision_cfg": {"image_size": 32, "layers": 1, "width": 64, "head_width": 32, "patch_size": 16},
        "text_cfg": {"context_length": 6, "vocab_size": 518, "width": 16, "heads": 2, "layers": 1},
    },
    "preprocess_cfg": {"mean": [0.5, 0.4, 0.3], "interpolation": "bilinear", "resize_mode": "squash"},
}
"""Features have 8 channels."""
CHECKPOINT = "open_clip_model.safetensors"


def write_tiny_clip(folder: Path) -> Path:
    """Write description, reduced vocabulary and a checkpoint in half precision into a folder, and return it."""
    (folder / "open_clip_config.json").write_text(json.dumps(DESCRIPTION))
    with gzip.open(folder / "bpe.txt.gz", "wt", encoding="utf-8") as file:
        file.write("#version: 0.2\nc h\nch a\ni r</w>\ncha ir</w>")
    torch.manual_seed(0)
    save_half(build_model("tiny", DESCRIPTION["model_cfg"]), folder / CHECKPOINT)
    return folder


def save_half(module: torch.nn.Module, path: Path) -> None:
    """Save weights in half precision."""
    save_file({name: value.half().contiguous() for name, value in module.state_dict().items()}, path)
