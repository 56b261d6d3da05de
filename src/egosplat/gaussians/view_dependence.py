"""How much view dependence a scene's colours need, judged on photographs that Gaussians have not been trained on.

All degrees of spherical harmonics come into use one after the other. When density control ends they are put to the test:
without a degree every Gaussian shows, over the cameras that see it, the mean of what the degree adds, which is the best
constant in its place. The least degree goes on by which photographs set aside are rendered as well. That lower degrees
were trained beside the higher ones, and not in their place, speaks for the higher ones: what goes is not needed.
"""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.evaluation import evaluate
from egosplat.gaussians.initialization import in_picture
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera, invert, transform
from egosplat.progress import log
from egosplat.rasterize.contract import MAX_SH_DEGREE
from egosplat.rasterize.sh_reference import sh_basis


@dataclass
class DegreeSearch:
    """What is known of the degree that a scene needs.

    Attributes:
        open: whether it is still to be decided.
        psnr: mean over the photographs set aside, with degree 0, 1, ... [dB]; None where it is not finite, and empty
            until it is decided.
    """

    open: bool = False
    psnr: list[float | None] = field(default_factory=list)

    def state_dict(self) -> dict[str, Any]:
        """All that ``DegreeSearch(**state)`` needs."""
        return asdict(self)


def settle_degree(
    search: DegreeSearch,
    gaussians: Gaussians,
    degree: int,
    training: Views,
    aside: Views,
    settings: RenderSettings,
    tolerance_db: float,
) -> Gaussians:
    """The Gaussians to go on with: themselves, or with fewer coefficients; closes ``search``.

    Where no photograph set aside has a valid pixel, nothing is known, and all stays.

    Args:
        search: open.
        gaussians: to be judged.
        degree: the highest in use.
        training: whose cameras tell from where the Gaussians are seen.
        aside: photographs that decide.
        settings: how to render them.
        tolerance_db: so much mean PSNR less than with ``degree`` is as good.
    """
    means = mean_basis(gaussians.means, training.camera, training.camera_to_world, settings.near_plane)
    candidates = [gaussians]
    for dropped in range(degree, 0, -1):
        candidates.insert(0, without_degree(candidates[0], dropped, means))
    psnr = [evaluate(some, aside, settings, used).mean_psnr for used, some in enumerate(candidates)]
    enough = next((used for used in range(degree) if psnr[used] >= psnr[degree] - tolerance_db), degree)
    search.open, search.psnr = False, [one if math.isfinite(one) else None for one in psnr]
    shown = ", ".join(f"{one:.2f}" for one in psnr)
    log(
        f"spherical harmonics of degree 0 to {degree}: {shown} dB on {len(aside)} photographs set aside; {enough} is enough"
    )
    return candidates[enough]


@torch.no_grad()
def without_degree(gaussians: Gaussians, degree: int, means: Tensor) -> Gaussians:
    """Gaussians with coefficients below ``degree`` alone, the mean of what it added taken into the constant.

    Args:
        gaussians: with coefficients of ``degree``, 1 at least.
        means: (N, 16) float32, see ``mean_basis``.
    """
    below, upto = degree**2, (degree + 1) ** 2
    sh = gaussians.sh.detach()[:, :below].clone()
    added = (means[:, below:upto, None] * gaussians.sh.detach()[:, below:upto]).sum(dim=1)
    # The first function is a constant; a mean of it is 0 for what no camera sees, which stays as it is.
    sh[:, 0] += added / sh_basis(0, means.new_zeros(1, 3))[0, 0]
    return replace(gaussians.detach(), sh=sh)


@torch.no_grad()
def mean_basis(
    means: Tensor, camera: Camera, camera_to_world: NDArray[np.float64], near_plane: float
) -> Tensor:
    """(N, 16) float32 mean of the spherical harmonics over the directions from which Gaussians are seen.

    Args:
        means: (N, 3) centres in the world [m].
        camera, camera_to_world: (V, 4, 4) float64; what hides behind a surface counts as seen. Rows of Gaussians that
            no camera has in its picture are 0.
        near_plane: least camera z [m].
    """
    points = means.double().cpu().numpy()
    total, number = np.zeros((len(points), (MAX_SH_DEGREE + 1) ** 2)), np.zeros(len(points))
    for pose in camera_to_world:
        local = transform(invert(pose), points)
        rows = np.flatnonzero(in_picture(local, camera, near_plane=near_plane))
        towards = points[rows] - pose[:3, 3]
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        total[rows] += sh_basis(MAX_SH_DEGREE, torch.from_numpy(towards)).numpy()
        number[rows] += 1
    mean = total / np.maximum(number, 1)[:, None]
    return torch.from_numpy(mean).to(means.device, torch.float32)
