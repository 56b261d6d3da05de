"""Device, number type and threads of PyTorch's computations."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.errors import UserError


@dataclass(frozen=True)
class Compute:
    """Device of a model's weights, and number type of its products, float32 or bfloat16; norms and positions stay in float32."""

    device: torch.device
    dtype: torch.dtype

    @contextlib.contextmanager
    def mixed(self) -> Iterator[None]:
        """Let models multiply in ``dtype`` in the block."""
        short = self.dtype != torch.float32
        # Else a GPU's convolutions round float32 to 10 bits.
        exact = torch.backends.cudnn.flags(enabled=True, allow_tf32=short)
        with torch.autocast(self.device.type, self.dtype, enabled=short), exact:
            yield

    @contextlib.contextmanager
    def inference(self) -> Iterator[None]:
        """``mixed``, and record no gradients in the block."""
        with torch.inference_mode(), self.mixed():
            yield


def all_finite(values: Tensor) -> bool:
    """Whether no number of a tensor is NaN or infinite, in a tenth of the time of ``isfinite``, which makes tensors of its size."""
    # Both extremes are NaN if one number is.
    return not values.numel() or all(bool(extreme.isfinite()) for extreme in values.aminmax())


def choose_compute(device: str, precision: str) -> Compute:
    """Device and number type for the configuration keys ``run.device`` and ``run.precision``.

    ``auto`` is a GPU if there is one, and bfloat16 on a GPU that supports it, else float32. UserError: ``cuda`` without a
    GPU, or ``bfloat16`` on a GPU without it.
    """
    gpu = torch.cuda.is_available()
    if device == "cuda" and not gpu:
        raise UserError("run.device = cuda: PyTorch finds no CUDA device; set it to auto or cpu")
    kind = device if device != "auto" else "cuda" if gpu else "cpu"
    return Compute(torch.device(kind), _dtype(kind, precision))


def _dtype(kind: str, precision: str) -> torch.dtype:
    if precision == "float32" or (precision == "auto" and kind == "cpu"):
        return torch.float32
    if kind == "cpu" or torch.cuda.is_bf16_supported():
        return torch.bfloat16
    if precision == "auto":
        return torch.float32
    raise UserError("run.precision = bfloat16: this GPU has no bfloat16; set it to auto or float32")


@contextlib.contextmanager
def single_thread() -> Iterator[None]:
    """Let PyTorch and the kernels compute with one thread in the block."""
    # With more threads oneDNN's gradients of 1 x 1 convolutions differ from run to run, whatever
    # torch.backends.mkldnn.deterministic is.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
