"""EWA projection of 3D Gaussians into one pinhole camera (Zwicker et al. 2002; 3DGS, section 4)."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from egosplat.rasterize.contract import ALPHA_THRESHOLD, FRUSTUM_MARGIN, Arguments

# Upper bound of the radii [px]: exact in float32 and int32, larger than any image.
MAX_RADIUS = 2**24


@dataclass(frozen=True)
class Projected:
    """Gaussians in one image; all numbers of a culled Gaussian are 0.

    Attributes:
        means2d: (N, 2) centers [px].
        conics: (N, 3) upper triangle (xx, xy, yy) of the inverse of the 2D covariance [1/px²].
        depths: (N,) camera z [m].
        radii: (N, 2) int32 half extents in x and y [px]; (0, 0) where culled.
        opacities: (N,) in [0, 1], compensated for the blur in antialiased mode.
    """

    means2d: Tensor
    conics: Tensor
    depths: Tensor
    radii: Tensor
    opacities: Tensor


def project(a: Arguments, camera: int) -> Projected:
    """Project Gaussians into one of the cameras, and cull those that cannot be seen.

    A Gaussian is culled if it lies outside the near and far planes, has an opacity below 1/255, has both radii
    at most ``radius_clip``, misses the image, or has a projection that is not finite and positive definite
    (as with a quaternion of length 0). Gradients reach ``means``, ``quats``, ``scales``, ``opacities`` and ``viewmats``.
    """
    # Cull first, without a graph, so that culled Gaussians cannot put NaN into the gradients.
    with torch.no_grad():
        means2d, depths, *shapes = _footprints(a, camera)
        radii = _radii(*shapes)
        size = means2d.new_tensor([a.width, a.height])
        overlaps = (means2d + radii > 0) & (means2d - radii < size)
        seen = overlaps.all(dim=-1) & (radii > a.radius_clip).any(dim=-1)
        seen &= (depths >= a.near_plane) & (depths <= a.far_plane)
    rows = seen.nonzero().squeeze(-1)
    names = ("means", "quats", "scales", "opacities")
    visible = replace(a, **{name: getattr(a, name).index_select(0, rows) for name in names})
    means2d, depths, covariances, dets, opacities = _footprints(visible, camera)
    uu, uv, vv = covariances.unbind(dim=-1)
    inverse = torch.stack([vv, -uv, uu], dim=-1) / dets[:, None]

    def scatter(values: Tensor) -> Tensor:
        return values.new_zeros(len(a.means), *values.shape[1:]).index_copy(0, rows, values)

    return Projected(
        means2d=scatter(means2d),
        conics=scatter(inverse),
        depths=scatter(depths),
        radii=torch.where(seen[:, None], radii, 0.0).clamp(max=MAX_RADIUS).to(torch.int32),
        opacities=scatter(opacities),
    )


def _footprints(a: Arguments, camera: int) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Centers [px], depths, blurred covariances (N, 3) with their determinants, and opacities of 2D Gaussians before culling."""
    viewmat, width, height, eps2d = a.viewmats[camera], a.width, a.height, a.eps2d
    fx, fy, cx, cy = a.Ks[camera][[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    rotation = viewmat[:3, :3]
    x, y, z = (a.means @ rotation.T + viewmat[:3, 3]).unbind(dim=-1)
    # The linearisation is worthless far outside the image: clamp its point to a slightly wider frustum.
    margin_x, margin_y = FRUSTUM_MARGIN * 0.5 * width / fx, FRUSTUM_MARGIN * 0.5 * height / fy
    slope_x = (x / z).clamp(-cx / fx - margin_x, (width - cx) / fx + margin_x)
    slope_y = (y / z).clamp(-cy / fy - margin_y, (height - cy) / fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian_u = torch.stack([fx / z, zero, -fx * slope_x / z], dim=-1)
    jacobian_v = torch.stack([zero, fy / z, -fy * slope_y / z], dim=-1)
    # Rows of J W R S, a square root of the 2D covariance (3DGS, equation 5).
    unit = a.quats / torch.linalg.vector_norm(a.quats, dim=-1, keepdim=True)
    axes = rotation @ rotation_matrices(unit) * a.scales[:, None, :]
    root_u = torch.einsum("ni,nij->nj", jacobian_u, axes)
    root_v = torch.einsum("ni,nij->nj", jacobian_v, axes)
    uu, uv, vv = (root_u * root_u).sum(-1), (root_u * root_v).sum(-1), (root_v * root_v).sum(-1)
    # Lagrange's identity: uu * vv - uv * uv would lose all digits in float32 for elongated Gaussians.
    det = torch.linalg.cross(root_u, root_v).square().sum(-1)
    blurred_det = det + eps2d * (uu + vv) + eps2d * eps2d
    opacities = a.opacities
    if a.antialiased:
        # Mip-Splatting (Yu et al. 2024): the blur enlarges the footprint, so the opacity falls by the ratio of areas.
        opacities = opacities * (det / blurred_det).clamp(min=0.0).sqrt()
    means2d = torch.stack([fx * x / z + cx, fy * y / z + cy], dim=-1)
    covariances = torch.stack([uu + eps2d, uv, vv + eps2d], dim=-1)
    return means2d, z, covariances, blurred_det, opacities


def rotation_matrices(quats: Tensor) -> Tensor:
    """(N, 4) quaternions wxyz of unit norm -> (N, 3, 3) rotations; of zeros the identity."""
    w, x, y, z = quats.unbind(dim=-1)
    entries = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(entries, dim=-1).unflatten(-1, (3, 3))


def _radii(covariances: Tensor, dets: Tensor, opacities: Tensor) -> Tensor:
    """Half extents (N, 2) [px] of the region with alpha >= 1/255, rounded up; 0 if empty or not finite."""
    # opacity exp(-r² / 2) = 1/255 solved for r, in standard deviations; NaN for opacities below 1/255.
    extents = (2.0 * (opacities / ALPHA_THRESHOLD).log()).sqrt()
    radii = (extents[:, None] * covariances[:, [0, 2]].sqrt()).ceil()
    usable = (dets > 0) & dets.isfinite() & radii.isfinite().all(dim=-1)
    return torch.where(usable[:, None], radii, 0.0)
