"""Where models run, and in which number type they multiply."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from egosplat.errors import UserError


@dataclass(frozen=True)
class Compute:
    """Where and in which number type a model runs.

    Attributes:
        device: where its weights lie.
        dtype: of its matrix products and convolutions: float32 or bfloat16. Weights, and what is sensitive
            (norms, positions), stay in float32.
    """

    device: torch.device
    dtype: torch.dtype

    @contextlib.contextmanager
    def inference(self) -> Iterator[None]:
        """Within, nothing is recorded for gradients, and models multiply in ``dtype``."""
        mixed = self.dtype != torch.float32
        with torch.inference_mode(), torch.autocast(self.device.type, self.dtype, enabled=mixed):
            yield


def choose_compute(device: str, precision: str) -> Compute:
    """Where to run, from the keys of the configuration.

    Args:
        device: ``auto`` (a GPU where there is one), ``cpu`` or ``cuda``.
        precision: ``auto`` (bfloat16 on a GPU that has it, else float32), ``float32`` or ``bfloat16``.

    Raises:
        UserError: there is no GPU for ``cuda``, or one without bfloat16 for ``bfloat16``.
    """
    gpu = torch.cuda.is_available()
    if device == "cuda" and not gpu:
        raise UserError("models.device = cuda: PyTorch finds no CUDA device; set it to auto or cpu")
    kind = device if device != "auto" else "cuda" if gpu else "cpu"
    return Compute(torch.device(kind), _dtype(kind, precision))


def _dtype(kind: str, precision: str) -> torch.dtype:
    if precision == "float32" or (precision == "auto" and kind == "cpu"):
        return torch.float32
    if kind == "cpu" or torch.cuda.is_bf16_supported():
        return torch.bfloat16
    if precision == "auto":
        return torch.float32
    raise UserError("models.precision = bfloat16: this GPU has no bfloat16; set it to auto or float32")
