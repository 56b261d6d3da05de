"""Where training runs."""

import importlib.util

import torch

from egosplat.kernels import library
from egosplat.rasterize.cuda import load_gsplat


def training_device(backend: str) -> torch.device:
    """The device for a rasterization backend; ``auto`` takes the GPU where there is one and gsplat for it.

    Raises:
        UserError: the backend ``cuda`` cannot run here.
    """
    if backend == "cuda":
        load_gsplat()
    usable = torch.cuda.is_available() and importlib.util.find_spec("gsplat") is not None
    return torch.device("cuda" if backend == "cuda" or (backend == "auto" and usable) else "cpu")


def rasterizer_used(backend: str, device: torch.device) -> str:
    """What renders there, for the record: ``cuda``, ``cpu`` with the kernels' variant, or ``reference``."""
    if device.type == "cuda":
        return f"cuda ({torch.cuda.get_device_name(device)})"
    if backend == "reference" or not library.is_compiled():
        return "reference"
    return f"cpu ({library.variant()})"
