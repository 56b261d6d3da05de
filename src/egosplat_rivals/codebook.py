"""The codebook of LEGaussians (Shi et al., CVPR 2024) over dense features: a mixture of tiles, and a regulariser's map."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.geometry import Camera
from egosplat_rivals.tile_views import TileViews

# Published: words; scales that are mixed, and what their sum is divided by; rows of the map of features.
WORDS = 128
MIXED, _DIVISOR = 6, 7
ROWS = 60

# Published: weight of the regulariser's half, weight of the even use of words, learning rate and decay. The rate falls
# to a tenth over 1,000 passes.
REGULARISER, _EVEN = 0.5, 1.0
_RATE, _DECAY, _LAST, _PASSES = 1e-4, 0.01, 0.1, 1000


def mixture(tiles: list[Tensor]) -> Tensor:
    """(rows, columns, D) sum of the first six scales at the grid of the first, nearest, divided by seven.

    Args:
        tiles: (rows, columns, D) of each scale.
    """
    size = tuple(tiles[0].shape[:2])
    grids = [
        F.interpolate(one.float().movedim(-1, 0)[None], size, mode="nearest")[0] for one in tiles[:MIXED]
    ]
    return torch.stack(grids).sum(dim=0).movedim(0, -1) / _DIVISOR


def dense_features(tiles: TileViews, frame: int, camera: Camera) -> Tensor:
    """(60, columns, D + K) features of a frame: the mixture of its tiles, and the regulariser; the pixels are square."""
    size = (ROWS, max(1, round(ROWS * camera.width / camera.height)))
    parts = [mixture([tiles.read(frame, number) for number in range(MIXED)])]
    if (regulariser := tiles.regulariser(frame)) is not None:
        parts.append(regulariser)
    resized = [F.interpolate(one.movedim(-1, 0)[None], size, mode="nearest")[0] for one in parts]
    return torch.cat(resized).movedim(0, -1)


class Codebook(nn.Module):
    """Words, (128, D + K), for features of two halves, each compared by direction, and their optimizer."""

    def __init__(self, channels: int, components: int, draw: torch.Generator) -> None:
        """Start from random words of ``channels`` D and ``components`` K, 0 without a regulariser."""
        super().__init__()
        values = (2 * torch.rand(WORDS, channels + components, generator=draw) - 1) / WORDS
        self.words = nn.Parameter(values)
        self.optimizer = torch.optim.AdamW([self.words], lr=_RATE, weight_decay=_DECAY)
        self._sizes = [channels, components]

    def likeness(self, features: Tensor) -> Tensor:
        """(R, 128) cosine of the first halves, plus the weighted cosine of the regulariser's."""
        halves = zip(features.split(self._sizes, 1), self.words.split(self._sizes, 1), strict=True)
        cosines = [F.normalize(rows, dim=1) @ F.normalize(words, dim=1).T for rows, words in halves]
        return cosines[0] + REGULARISER * cosines[1]

    def indices(self, features: Tensor) -> Tensor:
        """(R,) the word most like each feature."""
        return self.likeness(features).argmax(dim=1)

    def loss(self, features: Tensor) -> Tensor:
        """() distance from the chosen words, plus a term that is least if all words are chosen alike."""
        likeness = self.likeness(features)
        most = 1 + (REGULARISER if self._sizes[1] else 0)
        distance = most - likeness.amax(dim=1).mean()
        return distance + _EVEN * even_use(likeness)

    def set_rate(self, passes: float) -> None:
        """Set the learning rate after a number of passes over all images."""
        part = min(passes / _PASSES, 1.0)
        self.optimizer.param_groups[0]["lr"] = _RATE * (1 - (1 - _LAST) * part)


def even_use(likeness: Tensor) -> Tensor:
    """() sum over words of the share of (R, W) rows that choose it times its mean softmax; 1 / W if all are used alike."""
    share = likeness.argmax(dim=1).bincount(minlength=likeness.shape[1]) / max(1, len(likeness))
    return (share * likeness.softmax(dim=1).mean(dim=0)).sum()
