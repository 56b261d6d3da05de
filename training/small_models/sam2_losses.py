"""Losses of SAM2's training: masks, their predicted IoU, presence, and guidance of the features."""

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

# Weight of the focal loss relative to the dice loss, as in SAM (Kirillov et al. 2023).
_FOCAL_WEIGHT = 20.0


def mask_loss(logits: Tensor, share: Tensor, balance: float) -> Tensor:
    """Focal and dice loss, (...,), of (..., M, M) logits against the covered fraction of each cell.

    Args:
        balance: weight of a cross-entropy in which mask and background count equally.
    """
    # Masks are small: without the balanced term, everything is background for the first thousands of steps.
    logits, share = logits.flatten(-2), share.flatten(-2)
    probability = logits.sigmoid()
    entropy = F.binary_cross_entropy_with_logits(logits, share, reduction="none")
    focal = (entropy * (probability - share).detach().square()).mean(-1)
    overlap = 2 * (probability * share).sum(-1) + 1
    dice = 1 - overlap / (probability.square().sum(-1) + share.square().sum(-1) + 1)
    inside = (entropy * share).sum(-1) / share.sum(-1).clamp(min=1)
    outside = (entropy * (1 - share)).sum(-1) / (1 - share).sum(-1).clamp(min=1)
    return _FOCAL_WEIGHT * focal + dice + balance * (inside + outside)


@torch.no_grad()
def mask_iou(logits: Tensor, share: Tensor) -> Tensor:
    """IoU, (...,), of (..., M, M) logits, resized to the (..., N, N) fractions and thresholded at 0.

    Two empty masks have IoU 1.
    """
    enlarged = F.interpolate(logits.flatten(0, -3)[None], share.shape[-2:], mode="bilinear")[0] > 0
    truth = share.flatten(0, -3) > 0.5
    overlap = (enlarged & truth).flatten(1).sum(1)
    union = (enlarged | truth).flatten(1).sum(1)
    return torch.where(union > 0, overlap / union.clamp(min=1), 1.0).reshape(share.shape[:-2])


class PixelPairs(nn.Module):
    """Auxiliary loss: features of two pixels should be close exactly if both show the same piece.

    It uses one projection per level and is discarded after training.
    """

    def __init__(self, channels: int, levels: int = 3, width: int = 24, samples: int = 256) -> None:
        super().__init__()
        self.projections = nn.ModuleList([nn.Linear(channels, width) for _ in range(levels)])
        self.samples = samples

    def forward(self, features: Tensor, labels: Tensor) -> Tensor:
        """(B, C, h, w) features and (B, 3, h, w) int64 labels, -1 for none -> loss."""
        features, labels = features.flatten(2).transpose(1, 2), labels.flatten(2)
        chosen = torch.multinomial(self._weights(labels[:, 2]), self.samples)
        features = features.gather(1, chosen[..., None].expand(-1, -1, features.shape[-1]))
        total = features.new_zeros(())
        for level, projection in enumerate(self.projections):
            seen = labels[:, level].gather(1, chosen)
            same = (seen[:, :, None] == seen[:, None]).float()
            likeness = 4 - 3 * torch.cdist(projection(features), projection(features))
            entropy = F.binary_cross_entropy_with_logits(likeness, same, reduction="none")
            total = total + (entropy * same).sum() / same.sum()
            total = total + (entropy * (1 - same)).sum() / (1 - same).sum().clamp(min=1)
        return total / (2 * len(self.projections))

    @staticmethod
    def _weights(labels: Tensor) -> Tensor:
        """(B, P) sampling weight of each pixel."""
        # The power -0.7 of the label's area: a small object is drawn nearly as often as a large one.
        rows = []
        for row in labels:
            _, number, counts = torch.unique(row, return_inverse=True, return_counts=True)
            rows.append(counts.float()[number] ** -0.7)
        return torch.stack(rows)


class Names(nn.Module):
    """Auxiliary loss: features should predict a pixel's part name and the borders of subparts, parts and wholes.

    It uses two linear maps and is discarded after training.
    """

    def __init__(self, channels: int, names: int, levels: int = 3) -> None:
        """Args: ``names`` is the number of part names."""
        super().__init__()
        self.names = nn.Conv2d(channels, names, 1)
        self.ends = nn.Conv2d(channels, levels, 1)

    def forward(self, features: Tensor, labels: Tensor, names: Tensor) -> Tensor:
        """(B, C, h, w) features, (B, 3, h, w) and (B, h, w) int64 labels and names, -1 for none -> loss."""
        if bool((names >= 0).any()):
            loss = F.cross_entropy(self.names(features), names, ignore_index=-1)
        else:
            loss = features.new_zeros(())
        ends = torch.zeros_like(labels, dtype=features.dtype)
        ends[..., :, 1:] += labels[..., :, 1:] != labels[..., :, :-1]
        ends[..., 1:, :] += labels[..., 1:, :] != labels[..., :-1, :]
        ends = ends.clamp(max=1)
        entropy = F.binary_cross_entropy_with_logits(self.ends(features), ends, reduction="none")
        some = (entropy * ends).sum() / ends.sum().clamp(min=1)
        none = (entropy * (1 - ends)).sum() / (1 - ends).sum().clamp(min=1)
        return 0.5 * loss + 0.25 * (some + none)


class Guides(nn.Module):
    """The sum of the auxiliary losses on the encoder's features."""

    def __init__(self, channels: int, names: int, used: bool) -> None:
        super().__init__()
        self.used, self.pairs = used, PixelPairs(channels)
        self.names = Names(channels, names)

    def forward(self, features: Tensor, labels: NDArray[np.int32], names: NDArray[np.int32]) -> Tensor:
        """(B, C, h, w) features of stride 4, (B, 3, S, S) labels and (B, S, S) names -> loss; 0 if not ``used``."""
        if not self.used:
            return features.new_zeros(())
        coarse, called = (
            torch.from_numpy(np.ascontiguousarray(each[..., 1::4, 1::4])).long().to(features.device)
            for each in (labels, names)
        )
        return self.pairs(features, coarse) + self.names(features, coarse, called)
