"""Encode crops with OpenCLIP."""

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.codes.vectors import unit, usable
from egosplat.models.open_clip_loader import OpenClip


def encode(clip: OpenClip, crops: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Encode a batch of crops.

    Args:
        clip: the model.
        crops: (B, H, W, 3) uint8 at the model's size, B >= 1.

    Returns:
        (B, D) float32 of unit norm; NaN for a crop whose feature is zero or not finite.
    """
    wanted = clip.preprocessing
    device = clip.compute.device
    mean, std = (torch.tensor(values, device=device)[:, None, None] for values in (wanted.mean, wanted.std))
    with clip.compute.inference():
        pictures = torch.from_numpy(crops).to(device).permute(0, 3, 1, 2).float() / 255.0
        features = clip.model.encode_image((pictures - mean) / std).float().cpu().numpy()
    good = usable(features)
    return np.where(good[:, None], unit(np.where(good[:, None], features, 0.0)), np.nan).astype(np.float32)


def channels(clip: OpenClip) -> int:
    """Return D, the number of channels of the model's features."""
    return encode(clip, np.zeros((1, *clip.preprocessing.image_size, 3), np.uint8)).shape[1]
