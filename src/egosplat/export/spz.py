"""Write Gaussians as .spz, version 3 (github.com/nianticlabs/spz): about a tenth of the .ply file."""

import gzip
import math
from pathlib import Path

import numpy as np
import torch

from egosplat.errors import UserError, from_extra
from egosplat.files import atomic_file
from egosplat.gaussians.model import Gaussians
from egosplat.progress import log

# Natural logarithms of the least and the largest stored size: a byte holds sixteenths.
_LOG_SIZES = -10.0, 255 / 16 - 10.0

# Signs of the axes of OpenGL (right, up, back), and of the bases of degree 1 to 3 of spherical harmonics on them.
_TURNED = np.array([1, -1, -1], np.float32)
TURNED_SH = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)


def write_spz(path: Path, gaussians: Gaussians, sh_degree: int) -> None:
    """Write Gaussians on the CPU, whole or not at all, with the axes of OpenGL, as converters of .ply files
    do (UserError: gsply is not installed, or the format cannot hold the sizes of the Gaussians)."""
    with from_extra("gsply"):
        from gsply import GSData
        from gsply.spz import write_spz as write
    low, high = _LOG_SIZES
    typical = float(gaussians.log_scales.median()) if gaussians.count else low
    # The format cuts sizes outside of its limits, which shows in no number.
    if not low <= typical <= high:
        raise UserError(
            f"{path}: .spz stores sizes of {math.exp(low):.1g} to {math.exp(high):.0f}, and most Gaussians have about "
            f"{math.exp(typical):.1g}, in the world's unit. Set poses.meters_per_unit for the scene, or export ply"
        )
    # 24 bits hold a coordinate with its sign; those before the point reach all but the farthest 0.1 % of the Gaussians.
    farthest = gaussians.means.abs().amax(dim=1).double().numpy()
    reach = max(float(np.quantile(farthest, 0.999)), 1e-3) if len(farthest) else 1.0
    bits = int(np.clip(22 - np.ceil(np.log2(reach)), 1, 22))
    chosen = gaussians.select(torch.from_numpy(farthest < 2.0 ** (23 - bits)))
    if left_out := gaussians.count - chosen.count:
        told = f"{path}: {left_out} of {gaussians.count} Gaussians are too far away for this format"
        if not chosen.count:
            raise UserError(f"{told}. Export ply")
        log(told)
    rest = chosen.sh[:, 1 : (sh_degree + 1) ** 2].numpy()
    data = GSData(
        means=chosen.means.numpy() * _TURNED,
        scales=chosen.log_scales.numpy(),
        quats=torch.nn.functional.normalize(chosen.quats).numpy() * np.array([1, *_TURNED], np.float32),
        opacities=chosen.logit_opacities.numpy(),
        sh0=chosen.sh[:, 0].numpy(),
        shN=rest * TURNED_SH[: rest.shape[1], None],
    )
    with atomic_file(path) as scratch:
        write(scratch, data, version=3, fractional_bits=bits)
        # Without the time of compression: the same Gaussians give the same file.
        scratch.write_bytes(gzip.compress(gzip.decompress(scratch.read_bytes()), mtime=0))
