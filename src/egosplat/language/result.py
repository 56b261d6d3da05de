"""What a method gives: a code for each Gaussian and level, and how it came about."""

from dataclasses import dataclass, field

from torch import Tensor

from egosplat.artifacts.schemas import PIXELS
from egosplat.codes.decoder import Decoder


def fewer_iterations(done: int, published: int, of: str = "") -> tuple[str, ...]:
    """The stand-in of a shorter training than the authors'; none for one as long. ``of`` follows "iterations"."""
    return () if done >= published else (f"{done:,} of {published:,} iterations{of}",)


@dataclass(frozen=True)
class Curve:
    """Last iteration and mean loss of each record."""

    iteration: list[int] = field(default_factory=list)
    loss: list[float] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Coded:
    """Codes of N Gaussians at L levels, with C channels.

    Attributes:
        code: (N, L, C) float32.
        share: (N, L) float32 in [0, 1], how much of its compositing weight a Gaussian has in queries; 0 without a code.
        levels: name of each level.
        decoder: from codes to features, where the method learns its own; else that of features.zarr.
        curve: empty if nothing is trained.
        stands_in: short sentences, each on a part of the published method that something else replaces.
        decoded: what queries decode, see ``egosplat.artifacts.schemas``.
    """

    code: Tensor
    share: Tensor
    levels: list[str]
    decoder: Decoder | None = None
    curve: Curve = field(default_factory=Curve)
    stands_in: tuple[str, ...] = ()
    decoded: str = PIXELS
