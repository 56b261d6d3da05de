"""Checkpoint files of the published architectures, with random weights."""

from pathlib import Path

import timm
import torch
from safetensors.torch import save_file

from egosplat.models.checkpoints import clip_folder, sam2_config_file
from egosplat.models.open_clip_loader import build_model, read_description
from egosplat.models.sam2_loader import build_predictor

SAM2, CLIP = "sam2.1_hiera_b+", "ViT-B-16"

# Of the last weights that make masks: their logits are then far from 0 almost everywhere.
_STEEP = 50.0


def save_sam2(path: Path, architecture: str = SAM2) -> None:
    """Save SAM2 as its authors publish it: below the key ``model``."""
    predictor = build_predictor(sam2_config_file(architecture))
    decoder = predictor.sam_mask_decoder
    # Random weights would call most objects absent, and every mask bad and unstable.
    for head in (decoder.pred_obj_score_head, decoder.iou_prediction_head):
        torch.nn.init.constant_(head.layers[-1].bias, 5.0)
    for weights in decoder.output_hypernetworks_mlps:
        torch.nn.init.normal_(weights.layers[-1].weight, std=_STEEP)
    torch.save({"model": predictor.state_dict()}, path)


def save_clip(path: Path, architecture: str = CLIP) -> None:
    """Save OpenCLIP as its authors publish it: the bare tensors."""
    description = read_description(architecture, clip_folder(architecture))
    torch.save(build_model(architecture, description["model_cfg"]).state_dict(), path)


def save_encoder(path: Path, architecture: str) -> None:
    """Save a classifier of timm as its authors publish it: all of its tensors, as safetensors."""
    save_file(timm.create_model(architecture, pretrained=False).state_dict(), path)
