"""Fixtures: extreme Gaussians, and the compiled kernels in float32 compared with the reference in float64."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest
import torch
from torch import Tensor

from egosplat.rasterize import cpu
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.kernels import library
from egosplat.rasterize.reference import rasterizer as reference
from tests.support.splats import undecided

WIDTH, HEIGHT = 32, 24
SHAPE = ("means", "quats", "scales", "opacities", "colors")


@pytest.fixture(autouse=True)
def _kernels() -> None:
    if why_not := library.why_not():
        pytest.skip(why_not)


@pytest.fixture(scope="session")
def gaussian() -> Callable[..., dict[str, Tensor]]:
    """``gaussian(**changes)``: float32 arguments of a rotated Gaussian 2 m ahead with three different axes."""

    def make(**changes: object) -> dict[str, Tensor]:
        values = {
            "means": [[0.03, -0.02, 2.0]],
            "quats": [[0.9, 0.1, 0.2, 0.3]],
            "scales": [[0.1, 0.2, 0.15]],
            "opacities": [0.8],
            "colors": [[0.2, 0.5, 0.9]],
            "viewmats": np.eye(4)[None],
            "Ks": [[[30.0, 0, 16.0], [0, 28.0, 12.0], [0, 0, 1]]],
        }
        return {
            name: torch.as_tensor(np.asarray(value), dtype=torch.float32)
            for name, value in (values | changes).items()
        }

    return make


@dataclass(frozen=True)
class Rendered:
    """Image and alpha of one camera, (H, W, X + 1), the projections, and the gradients by name."""

    image: Tensor
    meta: dict[str, object]
    gradients: dict[str, Tensor]


@dataclass(frozen=True)
class Compared:
    """Results of the kernels in float32 and of the reference in float64."""

    values: dict[str, Tensor]
    found: Rendered
    truth: Rendered
    decided: Tensor

    @property
    def image_error(self) -> float:
        """Largest difference of a value, at pixels that rounding cannot change."""
        return float(((self.found.image - self.truth.image).abs() * self.decided[..., None]).max())

    @property
    def error(self) -> float:
        return max(self.image_error, self.gradient_error)

    @property
    def gradient_error(self) -> float:
        """The larger of the next two errors; infinite if a gradient is not finite."""
        return max(self.shape_error, self.pose_error)

    @property
    def shape_error(self) -> float:
        """Relative L2 error of the gradients by the logarithms of all parameters, positions in widths."""
        width = self.values["scales"].double().amax(dim=1, keepdim=True)
        sizes = {name: self.values[name].double() for name in SHAPE} | {"means": width}
        found, truth = (
            torch.cat([(each.gradients[name].double() * sizes[name]).flatten() for name in SHAPE])
            for each in (self.found, self.truth)
        )
        return _relative(found, truth)

    @property
    def pose_error(self) -> float:
        """Relative L2 error of the gradient with respect to the pose."""
        return _relative(self.found.gradients["viewmats"], self.truth.gradients["viewmats"])


def _relative(found: Tensor, truth: Tensor) -> float:
    difference = float((found.double() - truth).norm())
    if difference == 0:
        return 0.0
    return difference / float(truth.norm()) if np.isfinite(difference) and truth.any() else float("inf")


@pytest.fixture(scope="session")
def compare() -> Callable[..., Compared]:
    """``compare(values, width=, height=, **options)``: render and differentiate equal inputs with both backends."""

    def both(
        values: dict[str, Tensor], width: int = WIDTH, height: int = HEIGHT, **options: object
    ) -> Compared:
        options |= {"width": width, "height": height}
        doubles = {name: value.detach().double() for name, value in values.items()}
        decided = ~undecided(_forward(reference, doubles, options)[1])[0]
        found, truth = (
            _rendered(backend, values, dtype, decided, options)
            for backend, dtype in ((cpu, torch.float32), (reference, torch.float64))
        )
        return Compared(values, found, truth, decided)

    return both


@pytest.fixture(scope="session")
def cloud() -> Callable[[int, int], dict[str, Tensor]]:
    """``cloud(seed, count)``: float32 arguments of Gaussians, from specks to blobs as wide as the image."""

    def make(seed: int, count: int) -> dict[str, Tensor]:
        rng = np.random.default_rng(seed)
        arrays = {
            "means": rng.uniform([-0.7, -0.6, 1.5], [0.7, 0.6, 4.5], (count, 3)),
            "quats": rng.normal(size=(count, 4)),
            "scales": np.exp(rng.uniform(-4.5, -1.0, (count, 3))),
            "opacities": rng.uniform(0.01, 0.99, count),
            "colors": rng.uniform(size=(count, 3)),
            "viewmats": np.eye(4)[None],
            "Ks": np.array([[[40.0, 0, 16.0], [0, 38.0, 12.0], [0, 0, 1]]]),
        }
        return {name: torch.from_numpy(array).float() for name, array in arrays.items()}

    return make


def weights_of(shape: torch.Size) -> Tensor:
    """Fixed random float64 weights of an image, for a weighted sum to differentiate."""
    return torch.randn(shape, generator=torch.Generator().manual_seed(7), dtype=torch.float64)


def _rendered(
    backend: ModuleType, values: dict[str, Tensor], dtype: torch.dtype, decided: Tensor, options: dict
) -> Rendered:
    leaves = {
        name: value.detach().clone().to(dtype).requires_grad_(name != "Ks") for name, value in values.items()
    }
    image, meta = _forward(backend, leaves, options)
    (image * (weights_of(image.shape) * decided[..., None]).to(dtype)).sum().backward()
    gradients = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    return Rendered(image.detach(), meta, gradients)


def _forward(backend: ModuleType, values: dict[str, Tensor], options: dict) -> tuple[Tensor, dict]:
    image, alpha, meta = backend.rasterization(Arguments(**values, **options))
    return torch.cat([image[0], alpha[0]], dim=-1), meta
