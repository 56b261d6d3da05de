"""Write Gaussians as .spz, version 3 (github.com/nianticlabs/spz): about a tenth of the .ply file."""

import gzip
import math
import tempfile
from pathlib import Path

import numpy as np

from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.gaussians.model import Gaussians
from egosplat.progress import log

# Bits of a stored coordinate, with its sign.
_BITS = 24

# Natural logarithms of the least and the largest stored size: a byte holds sixteenths.
_LOG_SIZES = -10.0, 255 / 16 - 10.0

# Signs of the bases of degree 1 to 3 of spherical harmonics when y and z change theirs.
TURNED_SH = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)


def write_spz(path: Path, gaussians: Gaussians, sh_degree: int) -> None:
    """Write Gaussians on the CPU; the file is complete or absent.

    The file's axes are those of OpenGL (right, up, back), so y and z change their signs, as in the converters of .ply files.
    A few Gaussians far from all others may be left out: 24 bits hold a coordinate.

    Args:
        sh_degree: degree of the spherical harmonics in use, 0 to 3.

    Raises:
        UserError: gsply is not installed, or the format cannot hold the sizes of the Gaussians.
    """
    try:
        from gsply import GSData
        from gsply.spz import write_spz as write
    except ImportError:
        raise UserError(
            'gsply is not installed; it comes with the extra "export": pip install "egosplat[export]"'
        ) from None
    low, high = _LOG_SIZES
    typical = float(gaussians.log_scales.median()) if gaussians.count else low
    # The format cuts sizes outside of its limits, which shows in no number.
    if not low <= typical <= high:
        raise UserError(
            f"{path}: .spz stores sizes of {math.exp(low):.1g} to {math.exp(high):.0f}, and most Gaussians have about "
            f"{math.exp(typical):.1g}, in the world's unit. Set poses.meters_per_unit for the scene, or export ply"
        )
    bits = fractional_bits(gaussians)
    kept = (gaussians.means.abs() < 2.0 ** (_BITS - 1 - bits)).all(dim=1)
    if left_out := int((~kept).sum()):
        log(f"{path}: {left_out} of {gaussians.count} Gaussians are too far away for this format")
    some = gaussians.select(kept)
    quats = some.quats.numpy()
    length = np.maximum(np.linalg.norm(quats, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    turned = np.array([1, -1, -1], np.float32)
    rest = some.sh[:, 1 : (sh_degree + 1) ** 2].numpy()
    data = GSData(
        means=some.means.numpy() * turned,
        scales=some.log_scales.numpy(),
        quats=quats / length * np.array([1, *turned], np.float32),
        opacities=some.logit_opacities.numpy(),
        sh0=some.sh[:, 0].numpy(),
        shN=rest * TURNED_SH[: rest.shape[1], None],
    )
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "plain.spz"
        write(plain, data, version=3, fractional_bits=bits)
        content = gzip.decompress(plain.read_bytes())
    with atomic_file(path) as scratch:
        scratch.write_bytes(gzip.compress(content, mtime=0))


def fractional_bits(gaussians: Gaussians) -> int:
    """Bits after the point of a stored coordinate: as many as leave room for all but the farthest 0.1 % of the Gaussians."""
    farthest = gaussians.means.abs().amax(dim=1).double().numpy()
    reach = max(float(np.quantile(farthest, 0.999)), 1e-3) if len(farthest) else 1.0
    return int(np.clip(_BITS - 2 - np.ceil(np.log2(reach)), 1, _BITS - 2))
