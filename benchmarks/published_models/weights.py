"""Checkpoint files of the published architectures, with random weights."""

from pathlib import Path

import torch

from egosplat.models.configs import sam2_config_file
from egosplat.models.open_clip_loader import build_model, read_description
from egosplat.models.sam2_loader import build_predictor

SAM2, CLIP = "sam2.1_hiera_b+", "ViT-B-16"


def save_sam2(path: Path) -> None:
    """Save SAM2 as its authors publish it: below the key ``model``."""
    torch.save({"model": build_predictor(sam2_config_file(SAM2)).state_dict()}, path)


def save_clip(path: Path) -> None:
    """Save OpenCLIP as its authors publish it: the bare tensors."""
    torch.save(build_model(CLIP, read_description(CLIP, None)["model_cfg"]).state_dict(), path)
