"""The scene model: 3D Gaussians with colors and features, as raw optimized parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.rasterize.reference.projection import rotation_matrices

PARAMETERS = ("means", "quats", "log_scales", "logit_opacities", "sh", "features")


@dataclass
class Gaussians:
    """N Gaussians as unconstrained parameters (Kerbl et al. 2023), float32, all on one device; ValueError if shapes do not match.

    Attributes:
        means, quats: (N, 3) centers in the world [m]; (N, 4) rotations as wxyz quaternions, not normalized.
        log_scales: (N, 3) natural logarithm of the standard deviations along the axes [m].
        logit_opacities: (N,) logit of the opacity.
        sh: (N, K, 3) spherical harmonics of the color, K = (degree + 1)²; coefficient 0 is the constant one.
        features: (N, F) further channels that are rendered like colors; F may be 0.
    """

    means: Tensor
    quats: Tensor
    log_scales: Tensor
    logit_opacities: Tensor
    sh: Tensor
    features: Tensor

    def __post_init__(self) -> None:
        n, coefficients = len(self.means), self.sh.shape[1] if self.sh.ndim == 3 else -1
        wanted = {
            "means": (n, 3),
            "quats": (n, 4),
            "log_scales": (n, 3),
            "logit_opacities": (n,),
            "sh": (n, coefficients, 3),
            "features": (n, *self.features.shape[-1:]),
        }
        for name, tensor in self.parameters().items():
            if tuple(tensor.shape) != wanted[name]:
                raise ValueError(f"{name}: shape {tuple(tensor.shape)}, not {wanted[name]}")
            if tensor.dtype != torch.float32 or tensor.device != self.means.device:
                raise ValueError(
                    f"{name}: {tensor.dtype} on {tensor.device}, not float32 on {self.means.device}"
                )
        if (self.sh_degree + 1) ** 2 != coefficients:
            raise ValueError(f"sh: {coefficients} coefficients are no (degree + 1)²")

    @property
    def count(self) -> int:
        """Number of Gaussians N."""
        return len(self.means)

    @property
    def scales(self) -> Tensor:
        """(N, 3) standard deviations along the axes [m]."""
        return self.log_scales.exp()

    @property
    def opacities(self) -> Tensor:
        """(N,) opacities in (0, 1)."""
        return self.logit_opacities.sigmoid()

    @property
    def sh_degree(self) -> int:
        """Highest degree with coefficients in ``sh``."""
        return round(self.sh.shape[1] ** 0.5) - 1

    def parameters(self) -> dict[str, Tensor]:
        """Return the parameter tensors (no copies) by name, in the order of ``PARAMETERS``."""
        return {name: getattr(self, name) for name in PARAMETERS}

    def select(self, index: Tensor) -> "Gaussians":
        """Return the Gaussians at ``index``: (N,) bool, or (M,) int64 in any order, with repetition."""
        return Gaussians(**{name: tensor[index] for name, tensor in self.parameters().items()})

    @staticmethod
    def concatenate(parts: Sequence["Gaussians"]) -> "Gaussians":
        """Concatenate at least one set of Gaussians; K and F must match."""
        return Gaussians(**{name: torch.cat([getattr(part, name) for part in parts]) for name in PARAMETERS})

    def requires_grad_(self) -> "Gaussians":
        """Make every parameter a leaf that requires gradients, in place; returns self."""
        for tensor in self.parameters().values():
            tensor.requires_grad_()
        return self

    def detach(self) -> "Gaussians":
        """Return Gaussians that share storage, outside the autograd graph."""
        return Gaussians(**{name: tensor.detach() for name, tensor in self.parameters().items()})

    def to(self, device: torch.device) -> "Gaussians":
        """Return the Gaussians on ``device``."""
        return Gaussians(**{name: tensor.to(device) for name, tensor in self.parameters().items()})

    def finite(self) -> Tensor:
        """(N,) bool: every parameter is finite, and so is the exponential of the log scales."""
        # A log scale above 88 is finite, but its exponential is not.
        tensors = [*self.parameters().values(), self.scales]
        return torch.stack([as_rows(tensor.detach()).isfinite().all(dim=1) for tensor in tensors]).all(dim=0)


def as_rows(tensor: Tensor) -> Tensor:
    """Reshape (N, ...) to (N, columns), as a view of contiguous storage; N may be 0."""
    return tensor.unsqueeze(1) if tensor.ndim == 1 else tensor.flatten(1)


def rotations(quats: Tensor) -> Tensor:
    """Convert (N, 4) wxyz quaternions, not normalized, to (N, 3, 3) rotations; a zero quaternion gives the identity."""
    return rotation_matrices(torch.nn.functional.normalize(quats, dim=-1))
