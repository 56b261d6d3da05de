"""Choose the device and the rasterizer for training."""

import importlib.util

import torch

from egosplat.errors import UserError
from egosplat.progress import log
from egosplat.rasterize.cuda import load_gsplat
from egosplat.rasterize.kernels import library


def training_device(backend: str) -> torch.device:
    """Return the device for a rasterization backend. gsplat is loaded here, before a stage reads anything.
    ``auto`` selects the GPU if there is one and gsplat loads; if it does not load, the reason is logged.
    UserError: the backend is ``cuda``, and the GPU or its gsplat cannot run on this machine."""
    if backend == "cuda":
        load_gsplat()
        return torch.device("cuda")
    # A GPU without gsplat cannot render.
    if backend == "auto" and torch.cuda.is_available() and importlib.util.find_spec("gsplat") is not None:
        try:
            load_gsplat()
            return torch.device("cuda")
        except UserError as error:
            log(f"rendering on the CPU, which is slow. {error}")
    return torch.device("cpu")


def rasterizer_used(backend: str, device: torch.device) -> str:
    """Name the rasterizer for the artifact: ``cuda``, ``cpu`` with the kernel variant, or ``reference``."""
    if device.type == "cuda":
        return f"cuda ({torch.cuda.get_device_name(device)})"
    if backend == "reference" or not library.is_compiled():
        return "reference"
    return f"cpu ({library.variant()})"
