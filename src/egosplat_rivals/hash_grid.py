"""A multiresolution hash grid (Müller et al. 2022) over the contracted world of LERF (Kerr et al., ICCV 2023)."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

# Published: cells along an axis of the levels of both grids, and features of an entry.
RESOLUTIONS = tuple(
    int(first * (last / first) ** (level / 11))
    for first, last in ((16, 128), (128, 512))
    for level in range(12)
)
FEATURES = 8

# Entries of a level. The authors have 2^19, for whole houses; a room's surfaces need fewer.
ENTRIES = 2**16

# Primes of the usual hash of a cell's corner; entries start uniform within ``_START``.
_PRIMES, _START = (1, 2_654_435_761, 805_459_861), 1e-4


def contract(points: Tensor) -> Tensor:
    """(..., 3) points -> [0, 1]: the unit ball as it is, all beyond it in a shell around it."""
    # Divided by the largest number first, so that no square overflows.
    largest = points.abs().amax(dim=-1, keepdim=True).clamp(min=1.0)
    norm = largest * (points / largest).norm(dim=-1, keepdim=True)
    # Inside the ball the divisor is not used, but must not be 0.
    outside = norm.clamp(min=1.0)
    return (torch.where(norm <= 1, points, (2 - 1 / outside) * points / outside) + 2) / 4


class HashGrid(nn.Module):
    """Features of positions, interpolated at each level between the corners of a cell; gradients of ``table`` are sparse."""

    def __init__(self, draw: torch.Generator) -> None:
        """Start from small random features."""
        super().__init__()
        rows = len(RESOLUTIONS) * ENTRIES
        self.table = nn.Parameter((2 * torch.rand(rows, FEATURES, generator=draw) - 1) * _START)

    def forward(self, positions: Tensor) -> Tensor:
        """(R, 3) in [0, 1] -> (R, 192)."""
        entries, weights = corners(positions)
        # Each level of each position is one bag of the eight corners of its cell.
        bags, how = entries.flatten(0, 1), {"mode": "sum", "sparse": True}
        found = F.embedding_bag(bags, self.table, per_sample_weights=weights.flatten(0, 1), **how)
        return found.reshape(len(positions), len(RESOLUTIONS) * FEATURES)


def corners(positions: Tensor) -> tuple[Tensor, Tensor]:
    """Rows of the table, (R, 24, 8) int64, and weights, (R, 24, 8), of the corners of the cells that hold (R, 3) positions."""
    device = positions.device
    cells = torch.tensor(RESOLUTIONS, device=device)
    scaled = positions[:, None] * cells[:, None]
    low = scaled.floor().long().clamp(min=0).minimum(cells[:, None] - 1)
    part = scaled - low
    ends = torch.tensor([[(bit >> axis) & 1 for axis in range(3)] for bit in range(8)], device=device)
    corner = low[:, :, None] + ends
    weights = torch.where(ends.bool(), part[:, :, None], 1 - part[:, :, None]).prod(dim=-1)
    side = (cells + 1)[:, None]
    x, y, z = corner.unbind(-1)
    direct = x + side * (y + side * z)
    hashed = (x * _PRIMES[0]) ^ (y * _PRIMES[1]) ^ (z * _PRIMES[2])
    # A grid that fits the table needs no hash, and has no collisions.
    entries = torch.where(side**3 <= ENTRIES, direct, hashed % ENTRIES)
    return entries + torch.arange(len(cells), device=device)[:, None] * ENTRIES, weights
