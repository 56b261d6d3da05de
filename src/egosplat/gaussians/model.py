"""The scene: 3D Gaussians with colour and features, as the raw parameters that are optimised."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

PARAMETERS = ("means", "quats", "log_scales", "logit_opacities", "sh", "features")


@dataclass
class Gaussians:
    """N Gaussians as unconstrained parameters (Kerbl et al. 2023), float32, all on one device.

    Attributes:
        means: (N, 3) centres in the world [m].
        quats: (N, 4) rotations as wxyz quaternions, not normalised.
        log_scales: (N, 3) natural logarithm of the standard deviations along the axes [m].
        logit_opacities: (N,) logit of the opacity.
        sh: (N, K, 3) spherical harmonics of the colour, K = (degree + 1)²; coefficient 0 is the constant one.
        features: (N, F) further channels that are rendered like colours; F may be 0.

    Raises:
        ValueError: shapes, dtypes or devices that do not belong together.
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
            "features": (n, self.features.shape[-1]),
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
        """The highest degree that ``sh`` has coefficients for."""
        return round(self.sh.shape[1] ** 0.5) - 1

    def parameters(self) -> dict[str, Tensor]:
        """The parameters by name, in the order of ``PARAMETERS``; the tensors themselves, no copies."""
        return {name: getattr(self, name) for name in PARAMETERS}

    def select(self, index: Tensor) -> "Gaussians":
        """The Gaussians at ``index``: (N,) bool, or (M,) int64 in any order and with repetition."""
        return Gaussians(**{name: tensor[index] for name, tensor in self.parameters().items()})

    @staticmethod
    def concatenate(parts: Sequence["Gaussians"]) -> "Gaussians":
        """All Gaussians of ``parts`` (one at least) in order; K and F must be the same in all."""
        return Gaussians(**{name: torch.cat([getattr(part, name) for part in parts]) for name in PARAMETERS})

    def requires_grad_(self) -> "Gaussians":
        """Make every parameter a leaf that collects its gradient, in place; returns self."""
        for tensor in self.parameters().values():
            tensor.requires_grad_()
        return self

    def detach(self) -> "Gaussians":
        """The same storage outside of the autograd graph."""
        return Gaussians(**{name: tensor.detach() for name, tensor in self.parameters().items()})

    def to(self, device: torch.device) -> "Gaussians":
        """The same Gaussians on ``device``."""
        return Gaussians(**{name: tensor.to(device) for name, tensor in self.parameters().items()})

    def finite(self) -> Tensor:
        """(N,) bool: no parameter of the Gaussian is NaN or infinite, nor is a scale when exponentiated."""
        tensors = [*self.parameters().values(), self.scales]
        return torch.stack([as_rows(tensor.detach()).isfinite().all(dim=1) for tensor in tensors]).all(dim=0)


def as_rows(tensor: Tensor) -> Tensor:
    """(N, ...) -> (N, columns), a view of contiguous storage; works for N = 0 too."""
    return tensor.unsqueeze(1) if tensor.ndim == 1 else tensor.flatten(1)


def rotation_matrices(quats: Tensor) -> Tensor:
    """(N, 4) wxyz quaternions, not normalised -> (N, 3, 3) rotations; the identity for a zero quaternion."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], dim=-1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], dim=-1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], dim=-1),
    ]
    return torch.stack(rows, dim=-2)
