"""Run SAM2's image encoder once per image; prompts and tracking share the features."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.sam2_loader import Sam2

# Mean and standard deviation of ImageNet, with which SAM2 was trained.
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class EncodedImage:
    """Features of one image from SAM2's encoder.

    Attributes:
        features, positions: (h * w, 1, C) each, finest first, as ``SAM2Base.track_step`` takes them.
        sizes: (h, w) of each.
    """

    features: list[Tensor]
    positions: list[Tensor]
    sizes: list[tuple[int, int]]

    def expand(self, count: int) -> tuple[list[Tensor], list[Tensor]]:
        """Features and positions repeated for a batch of ``count`` objects, as views."""
        features = [feature.expand(-1, count, -1) for feature in self.features]
        return features, [position.expand(-1, count, -1) for position in self.positions]

    def image(self, level: int) -> Tensor:
        """(1, C, h, w) features of one level."""
        feature = self.features[level]
        return feature.permute(1, 2, 0).reshape(1, feature.shape[2], *self.sizes[level])


def encode(sam2: Sam2, image: NDArray[np.uint8]) -> EncodedImage:
    """Run the image encoder on a (H, W, 3) uint8 RGB image, resized to the model's square."""
    model = sam2.video_predictor
    values = torch.tensor(image, device=sam2.compute.device).permute(2, 0, 1)[None].float() / 255
    # SAM2 stretches images to a square, whatever their aspect.
    side = (model.image_size, model.image_size)
    values = F.interpolate(values, side, mode="bilinear", antialias=True, align_corners=False)
    mean, std = (torch.tensor(each, device=values.device)[:, None, None] for each in (_MEAN, _STD))
    encoded = model.forward_image((values - mean) / std)
    _, features, positions, sizes = model._prepare_backbone_features(encoded)
    return EncodedImage(list(features), list(positions), [tuple(size) for size in sizes])
