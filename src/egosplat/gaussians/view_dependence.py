"""Find the SH degree that a scene needs, on photographs outside the training.

Training enables all degrees one by one. When density control ends, each lower degree is tested, and the lowest degree
that renders the held-out photographs equally well is kept.
"""

import math
from dataclasses import dataclass, field, replace

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
from egosplat.rasterize.reference.spherical_harmonics import sh_basis


@dataclass
class DegreeSearch:
    """State of the search for the SH degree.

    Attributes:
        open: the degree is still undecided.
        psnr: mean over the held-out photographs with degree 0, 1, ... [dB]; None if not finite; empty until decided.
    """

    open: bool = False
    psnr: list[float | None] = field(default_factory=list)


def reduce_degree(
    search: DegreeSearch,
    gaussians: Gaussians,
    degree: int,
    training: Views,
    held_out: Views,
    settings: RenderSettings,
    tolerance_db: float,
) -> Gaussians:
    """Return the Gaussians with the lowest sufficient degree, and close ``search``.

    If no held-out photograph has a valid pixel, all coefficients stay.

    Args:
        search: open search.
        gaussians: Gaussians to test.
        degree: highest active degree.
        training: views whose cameras define the viewing directions.
        held_out: photographs that decide.
        tolerance_db: largest acceptable loss of mean PSNR against ``degree`` [dB].
    """
    means = mean_basis(gaussians.means, training.camera, training.camera_to_world, settings.near_plane)
    candidates = [gaussians]
    for dropped in range(degree, 0, -1):
        # The candidate of each degree is the next higher one without its highest terms.
        candidates.insert(0, without_degree(candidates[0], dropped, means))
    psnr = [evaluate(some, held_out, settings, used).mean_psnr for used, some in enumerate(candidates)]
    # Lower degrees were trained together with the higher ones, which favors these: a dropped degree was not needed.
    enough = next((used for used in range(degree) if psnr[used] >= psnr[degree] - tolerance_db), degree)
    search.open, search.psnr = False, [one if math.isfinite(one) else None for one in psnr]
    shown = ", ".join(f"{one:.2f}" for one in psnr)
    log(
        f"spherical harmonics of degree 0 to {degree}: {shown} dB on {len(held_out)} held-out photographs; degree {enough} is sufficient"
    )
    return candidates[enough]


@torch.no_grad()
def without_degree(gaussians: Gaussians, degree: int, means: Tensor) -> Gaussians:
    """Drop the coefficients from ``degree`` on, and add the mean of their contribution to the constant.

    Args:
        gaussians: Gaussians with coefficients of ``degree``, at least 1.
        means: (N, 16) float32 from ``mean_basis``.
    """
    # The mean over the cameras that see a Gaussian is the best constant for the dropped terms.
    below, upto = degree**2, (degree + 1) ** 2
    sh = gaussians.sh.detach()[:, :below].clone()
    added = (means[:, below:upto, None] * gaussians.sh.detach()[:, below:upto]).sum(dim=1)
    # Divided by the constant basis function. The means are 0 for Gaussians that no camera sees: those stay as they are.
    sh[:, 0] += added / sh_basis(0, means.new_zeros(1, 3))[0, 0]
    return replace(gaussians.detach(), sh=sh)


@torch.no_grad()
def mean_basis(
    means: Tensor, camera: Camera, camera_to_world: NDArray[np.float64], near_plane: float
) -> Tensor:
    """Return the (N, 16) float32 mean of the spherical harmonics over the directions that see each Gaussian.

    Occlusion is ignored. Rows of Gaussians outside every image are 0.

    Args:
        means: (N, 3) centers in the world [m].
        camera_to_world: (V, 4, 4) float64.
        near_plane: smallest camera z [m].
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
