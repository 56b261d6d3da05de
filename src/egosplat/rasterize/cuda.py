"""The rasterizer backend for CUDA devices: gsplat."""

import contextlib
import fcntl
import importlib
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.rasterize.contract import Arguments, Render, camera_centers, usable_gaussians
from egosplat.rasterize.reference import rasterizer as reference

# gsplat 1.6 changed the arguments for spherical harmonics and limits alpha to 0.99 instead of 0.999.
OLDEST_GSPLAT, TOO_NEW_GSPLAT = (1, 5, 3), (1, 6)

# Memory of one of the compilers that build gsplat, an estimate.
COMPILER_BYTES = 2 * 2**30

# Most channels per pass. gsplat is slow beyond 32, except 33 (32 and a depth), which it compiles as one pass.
LARGEST_PASS = 33

# A Gaussian closer to the camera center has no viewing direction [m]; the near plane culls it.
SMALLEST_DISTANCE = 1e-6


def rasterization(arguments: Arguments) -> Render:
    """``api.rasterization`` with gsplat, in float32 on a CUDA device (UserError: there is no CUDA device or
    no supported gsplat, or the tensors are not float32 on a CUDA device)."""
    gsplat, means = load_gsplat(), arguments.means
    if means.dtype != torch.float32 or not means.is_cuda:
        raise UserError(
            f"backend cuda renders float32 on a CUDA device, not {means.dtype} on {means.device}: use auto"
        )
    # gsplat divides by the number of Gaussians.
    return render(gsplat, arguments) if len(means) else reference.rasterization(arguments)


def load_gsplat() -> ModuleType:
    """Import gsplat, which compiles itself on the first import; other processes wait until it has (UserError:
    it is missing, too old, too new or does not load, or there is no CUDA device)."""
    # Without a device gsplat would still try to compile and fail with a misleading message.
    if not torch.cuda.is_available():
        raise UserError("backend cuda: PyTorch finds no CUDA device; use the backend auto or cpu")
    advice = (
        'run: pip install "egosplat[cuda]" (gsplat compiles itself once and needs nvcc of '
        f"CUDA {torch.version.cuda}), or set backend to cpu"
    )
    try:
        gsplat = importlib.import_module("gsplat")
        with _alone_if_compiling():
            compiled = importlib.import_module("gsplat.cuda._backend")._C
    except (ImportError, OSError, RuntimeError) as error:
        raise UserError(f"backend cuda: gsplat cannot be loaded ({error}); {advice}") from error
    if problem := unsupported(gsplat.__version__):
        raise UserError(f"backend cuda: gsplat {gsplat.__version__} {problem}; {advice}")
    if compiled is None:
        raise UserError(f"backend cuda: gsplat found no CUDA toolkit to compile itself with; {advice}")
    return gsplat


@contextlib.contextmanager
def _alone_if_compiling() -> Iterator[None]:
    """Hold a file lock in the block, with as many compilers as memory allows; nothing if gsplat is loaded already."""
    if "gsplat.cuda._backend" in sys.modules:
        yield
        return
    from torch.utils import cpp_extension

    # Where PyTorch compiles extensions. gsplat removes this folder of another process that compiles at the same time.
    folder = os.environ.get("TORCH_EXTENSIONS_DIR") or cpp_extension.get_default_build_root()
    Path(folder).mkdir(parents=True, exist_ok=True)
    with (Path(folder) / "egosplat_gsplat.lock").open("w") as lock:
        with contextlib.suppress(OSError):  # some network file systems have no locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        # gsplat's own default is 10 compilers, whatever the memory.
        os.environ.setdefault("MAX_JOBS", str(_compilers()))
        yield


def _compilers() -> int:
    """Number of compilers to run at once: one for each core and for each 2 GiB of memory."""
    free = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES")
    if job := os.environ.get("SLURM_MEM_PER_NODE"):  # MiB
        free = min(free, int(job) * 2**20)
    return max(1, min(len(os.sched_getaffinity(0)), free // COMPILER_BYTES))


def unsupported(version: str) -> str | None:
    """Why a version of gsplat (such as ``1.5.3+pt24cu124``) is unsupported: "is too old"; None if supported."""
    numbers = tuple(int(part) for part in re.split(r"[^\d.]", version)[0].split(".") if part)
    if numbers < OLDEST_GSPLAT:
        return "is too old"
    if numbers >= TOO_NEW_GSPLAT:
        return "is too new: 1.6 renders differently and takes other arguments"
    return None


def render(gsplat: ModuleType, arguments: Arguments) -> Render:
    """Translate one call of ``rasterization`` into gsplat's, for N > 0 Gaussians."""
    a = _without_unusable(arguments)
    if a.shows_colors:
        channels, backgrounds = _channels(gsplat, a), a.backgrounds
    else:
        # gsplat requires colors even in modes that do not render them.
        channels, backgrounds = a.opacities[:, None], None
    # Of the same names in gsplat, but for what the channels hold.
    names = {field.name for field in fields(Arguments)} - {"sh_degree", "features"}
    given = {name: getattr(a, name) for name in names} | {"colors": channels, "backgrounds": backgrounds}
    image, alpha, meta = gsplat.rasterization(
        **given,
        # Packed results lose the (C, N) layout, and gsplat 1.5.3 fails on them with backgrounds.
        packed=False,
        channel_chunk=min(channels.shape[-1] + a.shows_depth, LARGEST_PASS),
    )
    kept = ("means2d", "radii", "depths", "conics", "opacities", "width", "height", "n_cameras")
    return image, alpha, {name: meta[name] for name in kept}


def _without_unusable(a: Arguments) -> Arguments:
    """Replace Gaussians that must be culled by harmless numbers with opacity 0."""
    harmless = {"means": 0.0, "quats": 1.0, "scales": 1.0, "opacities": 0.0, "colors": 0.0, "features": 0.0}
    values = {name: getattr(a, name) for name in harmless if getattr(a, name) is not None}
    usable = usable_gaussians(a.quats, *values.values())
    if usable.all():
        return a

    def replaced(value: Tensor, by: float) -> Tensor:
        # ``where``, not a product: a replaced value gets a gradient of zero even if its own would be NaN.
        return torch.where(usable.reshape(-1, *[1] * (value.ndim - 1)), value, by)

    return replace(a, **{name: replaced(value, harmless[name]) for name, value in values.items()})


def _channels(gsplat: ModuleType, a: Arguments) -> Tensor:
    """(N, D + F), or with spherical harmonics (C, N, 3 + F)."""
    colors = a.colors if a.sh_degree is None else _view_colors(gsplat, a)
    if a.features is None:
        return colors
    return torch.cat([colors, a.features.expand(*colors.shape[:-1], a.features.shape[-1])], dim=-1)


def _view_colors(gsplat: ModuleType, a: Arguments) -> Tensor:
    """(C, N, 3) colors; arbitrary for Gaussians at the camera center."""
    # Evaluated here because gsplat's rasterization takes no more channels next to spherical harmonics.
    dirs = a.means - camera_centers(a.viewmats)[:, None, :]
    # A Gaussian without direction would get NaN gradients from gsplat.
    masks = torch.linalg.vector_norm(dirs.detach(), dim=-1) > SMALLEST_DISTANCE
    coeffs = a.colors.expand(len(a.viewmats), *a.colors.shape)
    colors = gsplat.spherical_harmonics(a.sh_degree, dirs, coeffs, masks=masks)
    return (colors + 0.5).clamp(min=0.0)
