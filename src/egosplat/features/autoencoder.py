"""LangSplat's feature autoencoder, from its description (docs/method.md#autoencoder)."""

import math
from collections.abc import Callable
from copy import deepcopy
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from egosplat.arrays import Floats
from egosplat.compute import single_thread
from egosplat.errors import UserError
from egosplat.language.decoder import Decoder
from egosplat.progress import log, track

# Channels of the hidden layers: LangSplat's defaults.
ENCODER, DECODER = (256, 128, 64, 32), (16, 32, 64, 128, 256, 256)

# LangSplat's.
BATCH, LEARNING_RATE, COSINE_WEIGHT = 64, 7e-4, 0.001

# The best of this last fraction of the epochs is kept: 5 of LangSplat's 100.
_JUDGED = 0.05

_ROWS_AT_ONCE = 2**14


class Autoencoder(nn.Module):
    """Map features of ``width`` channels to codes of ``dims`` channels, and back; both have unit norm."""

    def __init__(self, width: int, dims: int) -> None:
        super().__init__()
        sizes = [*ENCODER, dims]
        layers: list[nn.Module] = [nn.Linear(width, sizes[0])]
        # Only the encoder has batch normalization. The decoder is stored as plain matrices, see ``_decoder_of``.
        for before, after in pairwise(sizes):
            layers += [nn.BatchNorm1d(before), nn.ReLU(), nn.Linear(before, after)]
        self.encoder = nn.Sequential(*layers)
        sizes = [dims, *DECODER, width]
        layers = [nn.Linear(dims, sizes[1])]
        for before, after in pairwise(sizes[1:]):
            layers += [nn.ReLU(), nn.Linear(before, after)]
        self.decoder = nn.Sequential(*layers)

    def encode(self, features: Tensor) -> Tensor:
        """(R, D) features -> (R, C) codes."""
        return F.normalize(self.encoder(features), dim=-1)

    def forward(self, features: Tensor) -> Tensor:
        """(R, D) -> (R, D), through the code."""
        return F.normalize(self.decoder(self.encode(features)), dim=-1)


def fit_autoencoder(
    features: Floats, dims: int, epochs: int, seed: int
) -> tuple[Callable[[Floats], Floats], Decoder]:
    """Train codes of ``dims`` channels on (R, D) float32 rows, zeros allowed; equal rows and seed give equal weights.

    UserError: training diverges.

    Returns:
        The encoder as a function of (R, D) float32 rows, and the decoder.
    """
    # Leaves the global random generator untouched.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Autoencoder(features.shape[1], dims)
    if len(features):
        with single_thread():
            # More threads sum in another order, which ends in other codes; batches are too small to gain from them.
            model.load_state_dict(_trained(model, torch.from_numpy(features), epochs, seed))
    model.eval()

    def encode(rows: Floats) -> Floats:
        with torch.inference_mode(), single_thread():
            parts = [model.encode(part) for part in torch.from_numpy(rows).split(_ROWS_AT_ONCE)]
        return torch.cat(parts).numpy() if parts else np.zeros((0, dims), np.float32)

    return encode, _decoder_of(model)


def _trained(model: Autoencoder, rows: Tensor, epochs: int, seed: int) -> dict[str, Tensor]:
    """Return the best weights of the last epochs, by the error on all rows."""
    order = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.Adam(model.parameters(), lr=LEARNING_RATE, fused=True)
    least, best = math.inf, None
    judged = epochs - max(1, round(_JUDGED * epochs))
    for epoch in track(range(epochs), "training the autoencoder", unit="epoch"):
        model.train()
        for batch in batches(len(rows), order):
            optimizer.zero_grad()
            loss(model(rows[batch]), rows[batch], COSINE_WEIGHT).backward()
            optimizer.step()
        # NaN compares as False: a diverged model is never the best.
        if epoch >= judged and (now := _error(model, rows)) < least:
            least, best = now, deepcopy(model.state_dict())
    if best is None:
        raise UserError("features.compression = autoencoder: training diverged; set it to linear")
    log(f"autoencoder: error {least:.4f} after {epochs} epochs")
    return best


def loss(decoded: Tensor, features: Tensor, cosine_weight: float) -> Tensor:
    """Mean squared error plus the weighted mean of 1 - cosine, over (B, D) rows."""
    # Over the channels of a feature. LangSplat's code takes it over the batch, which compares unrelated features.
    cosine = F.cosine_similarity(decoded, features, dim=1).mean()
    return F.mse_loss(decoded, features) + cosine_weight * (1 - cosine)


def batches(count: int, order: torch.Generator) -> list[Tensor]:
    """Split all rows into random batches of at least two rows."""
    rows = torch.randperm(count, generator=order)
    parts = list(rows.split(BATCH))
    # Batch normalization cannot train on a single row. It joins the batch before it, or is doubled.
    if len(parts[-1]) > 1:
        return parts
    alone = parts.pop()
    return [*parts[:-1], torch.cat([parts[-1], alone])] if parts else [alone.repeat(2)]


@torch.inference_mode()
def _error(model: Autoencoder, rows: Tensor) -> float:
    model.eval()
    # LangSplat judges with the full cosine, not with its training weight of 0.001.
    parts = [loss(model(part), part, 1.0) * len(part) for part in rows.split(_ROWS_AT_ONCE)]
    return float(torch.stack(parts).sum()) / len(rows)


def _decoder_of(model: Autoencoder) -> Decoder:
    layers = [layer for layer in model.decoder if isinstance(layer, nn.Linear)]
    widths = (layers[0].in_features, *(layer.out_features for layer in layers))
    numbers = [part.detach().ravel() for layer in layers for part in (layer.weight, layer.bias)]
    return Decoder(widths, torch.cat(numbers).numpy())
