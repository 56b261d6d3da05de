"""The contract of all backends of ``rasterization``: constants, modes, arguments and their validation.

Notation: N Gaussians, C cameras, K spherical-harmonics coefficients, D colors, F features, X output channels.
The semantics are those of gsplat 1.5.3's ``rasterization``; ``api.rasterization`` documents them.
"""

from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Any, get_args

import torch
from torch import Tensor

# Lower alphas are skipped; 8-bit images cannot show them.
ALPHA_THRESHOLD = 1.0 / 255.0

# Upper bound of alpha: keeps ``1 - alpha`` away from zero.
MAX_ALPHA = 0.999

# The first Gaussian that would lower the transmittance to this or less ends the pixel and is not composited.
MIN_TRANSMITTANCE = 1e-4

# The projection is linearised at most this fraction of half the field of view outside the image.
FRUSTUM_MARGIN = 0.3

# Lower bound of the divisor of the expected depth, as in gsplat: depth 0 where nothing is visible.
MIN_DEPTH_ALPHA = 1e-10

# Largest camera z that is rendered.
FAR_PLANE = 1e10

MAX_SH_DEGREE, MOST_PIXELS = 3, 2**28
RENDER_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
RASTERIZE_MODES = ("classic", "antialiased")

# What is taken for each annotation of the arguments.
_TYPES = {Tensor: (Tensor, "a tensor"), str: (str, "a text"), int: (Integral, "a whole number")}
_TYPES |= {float: (Real, "a number")}

# Images (C, H, W, X), alpha (C, H, W, 1) and meta, as ``api.rasterization`` documents them.
Render = tuple[Tensor, Tensor, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Arguments:
    """The arguments of ``api.rasterization``, which documents them; ``check`` validates them."""

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    colors: Tensor
    viewmats: Tensor
    Ks: Tensor
    width: int
    height: int
    near_plane: float = 0.1
    far_plane: float = FAR_PLANE
    radius_clip: float = 0.0
    eps2d: float = 0.3
    sh_degree: int | None = None
    features: Tensor | None = None
    backgrounds: Tensor | None = None
    render_mode: str = "RGB"
    rasterize_mode: str = "classic"

    @property
    def antialiased(self) -> bool:
        """Whether opacities are lowered to compensate for the blur of ``eps2d``."""
        return self.rasterize_mode == "antialiased"

    @property
    def shows_colors(self) -> bool:
        """Whether colors and features are rendered."""
        return self.render_mode.startswith("RGB")

    @property
    def shows_depth(self) -> bool:
        """Whether a depth is rendered, as the last channel."""
        return self.render_mode.endswith("D")

    @property
    def shows_expected_depth(self) -> bool:
        """Whether the depth is divided by the accumulated alpha."""
        return self.render_mode.endswith("ED")


def check(arguments: Arguments) -> None:
    """Validate the arguments of ``rasterization``; Gaussians may have non-finite numbers, cameras may not
    (ValueError: a shape, dtype, device, number or mode is not as ``rasterization`` documents)."""
    a = arguments
    for field in fields(a):
        kind, *optional = get_args(field.type) or (field.type,)
        _check_type(field.name, getattr(a, field.name), kind, bool(optional))
    _check_choice("render_mode", a.render_mode, RENDER_MODES)
    _check_choice("rasterize_mode", a.rasterize_mode, RASTERIZE_MODES)
    _check_numbers(a)
    _check_kind({name: value for name, value in vars(a).items() if isinstance(value, Tensor)})
    n = a.means.shape[0] if a.means.ndim else -1
    c = a.viewmats.shape[0] if a.viewmats.ndim else -1
    _check_shape("means", a.means, (n, 3))
    _check_shape("quats", a.quats, (n, 4))
    _check_shape("scales", a.scales, (n, 3))
    _check_shape("opacities", a.opacities, (n,))
    channels = _color_channels(a.colors, n, a.sh_degree)
    if a.features is not None:
        _check_shape("features", a.features, (n, *a.features.shape[-1:]))
        channels += a.features.shape[-1]
    if channels == 0:
        raise ValueError("colors and features hold no channel")
    if a.backgrounds is not None:
        _check_shape("backgrounds", a.backgrounds, (c, channels))
        if a.backgrounds.device.type == "cpu" and not a.backgrounds.isfinite().all():
            raise ValueError("backgrounds hold a number that is not finite")
    if c < 1:
        raise ValueError(f"viewmats has shape {tuple(a.viewmats.shape)}: at least one camera is needed")
    _check_shape("viewmats", a.viewmats, (c, 4, 4))
    _check_shape("Ks", a.Ks, (c, 3, 3))
    # On a GPU their numbers are not read, because the CPU would wait for it; ``render`` checks them before the copy.
    if a.viewmats.device.type == "cpu":
        check_cameras(a.viewmats, a.Ks)


def check_cameras(viewmats: Tensor, Ks: Tensor) -> None:
    """Validate the numbers of cameras, (C, 4, 4) and (C, 3, 3) on the CPU (ValueError: a number is not
    finite, a focal length is not positive, or there is skew)."""
    view, intrinsics = viewmats.detach().flatten(1), Ks.detach().flatten(1)
    if not (view.isfinite().all() and intrinsics.isfinite().all()):
        raise ValueError("viewmats or Ks hold a number that is not finite")
    if (intrinsics[:, [0, 4]] <= 0).any():
        raise ValueError(f"focal lengths must be positive: {intrinsics[:, [0, 4]].tolist()}")
    if (intrinsics[:, 1] != 0).any():
        raise ValueError(f"Ks must have no skew: {intrinsics[:, 1].tolist()}")


def _check_type(name: str, value: object, kind: Any, optional: bool) -> None:
    type_, told = _TYPES[kind]
    if isinstance(value, bool) or not (isinstance(value, type_) or (optional and value is None)):
        raise ValueError(f"{name} is {value!r:.40}, not {told}")


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ValueError(f"{name} is {value!r}, not one of {', '.join(choices)}")


def _check_numbers(a: Arguments) -> None:
    if min(a.width, a.height) < 1 or a.width * a.height > MOST_PIXELS:
        raise ValueError(f"the image is {a.width} x {a.height} pixels; 1 to {MOST_PIXELS:,} are drawn")
    # A positive near plane keeps the perspective division and the viewing direction finite.
    if not 0.0 < a.near_plane < a.far_plane:
        raise ValueError(f"near_plane {a.near_plane} and far_plane {a.far_plane} must satisfy 0 < near < far")
    if not (a.radius_clip >= 0.0 and a.eps2d >= 0.0):
        raise ValueError(f"radius_clip {a.radius_clip} and eps2d {a.eps2d} must not be negative")


def _check_kind(tensors: dict[str, Tensor]) -> None:
    dtype, device = tensors["means"].dtype, tensors["means"].device
    if dtype not in (torch.float32, torch.float64):
        raise ValueError(f"means are {dtype}; float32 or float64 is needed")
    for name, tensor in tensors.items():
        if tensor.dtype != dtype or tensor.device != device:
            raise ValueError(f"{name} is {tensor.dtype} on {tensor.device}, means are {dtype} on {device}")


def _check_shape(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(tensor.shape) != shape:
        raise ValueError(f"{name} has shape {tuple(tensor.shape)}, not {shape}")


def _color_channels(colors: Tensor, n: int, sh_degree: int | None) -> int:
    if sh_degree is None:
        if colors.ndim != 2 or colors.shape[0] != n:
            raise ValueError(f"colors has shape {tuple(colors.shape)}, not ({n}, D)")
        return colors.shape[1]
    if not 0 <= sh_degree <= MAX_SH_DEGREE:
        raise ValueError(f"sh_degree is {sh_degree}, not 0 to {MAX_SH_DEGREE}")
    # More coefficients than ``sh_degree`` uses are allowed: training enables degrees one by one.
    counts = [(degree + 1) ** 2 for degree in range(MAX_SH_DEGREE + 1)]
    if colors.ndim != 3 or colors.shape[::2] != (n, 3) or colors.shape[1] not in counts[sh_degree:]:
        raise ValueError(
            f"colors has shape {tuple(colors.shape)}; sh_degree {sh_degree} needs ({n}, K, 3) "
            f"with K one of {counts[sh_degree:]}"
        )
    return 3


def usable_gaussians(quats: Tensor, *values: Tensor) -> Tensor:
    """(N,) bool: Gaussians with only finite numbers in (N, ...) ``values`` and a quaternion (N, 4) of nonzero length."""
    norms = torch.linalg.vector_norm(quats.detach(), dim=-1)
    usable = (norms > 0) & norms.isfinite()
    for value in values:
        usable = usable & value.detach()[..., None].isfinite().flatten(1).all(dim=-1)
    return usable


def camera_centers(viewmats: Tensor) -> Tensor:
    """(C, 4, 4) world_to_camera -> (C, 3) centers in the world; differentiable. The last row is ignored."""
    # A general inverse instead of the transpose: its gradients by the pose hold for any matrix.
    # ``solve_ex`` does not read its error flag, for which the CPU would wait for a GPU.
    return torch.linalg.solve_ex(viewmats[:, :3, :3], -viewmats[:, :3, 3]).result
