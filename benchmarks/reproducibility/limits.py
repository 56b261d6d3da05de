"""Environment variables that make libraries choose the code for another processor."""

import ctypes
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Limit:
    """A column of the table.

    Attributes:
        name: its heading.
        variables: environment variables to set.
        chain: whether each stage takes what the stages before it have made under the limit, and not the
            reference's artifacts.
    """

    name: str
    variables: dict[str, str] = field(default_factory=dict)
    chain: bool = False


KERNELS = {"EGOSPLAT_KERNEL": "avx2"}
NUMPY = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"}
OPENBLAS = {"OPENBLAS_CORETYPE": "Haswell"}
OPENCV = {"OPENCV_CPU_DISABLE": "AVX512-SKX"}
TORCH = {"ATEN_CPU_CAPABILITY": "avx2"}
ONEDNN = {"ONEDNN_MAX_CPU_ISA": "AVX2"}
MKL = {"MKL_ENABLE_INSTRUCTIONS": "AVX2"}
AVX2 = KERNELS | NUMPY | OPENBLAS | OPENCV | TORCH | ONEDNN | MKL

REFERENCE = Limit("reference")

LIMITS = (
    Limit("again"),
    Limit("kernels avx2", KERNELS),
    Limit("kernels generic", {"EGOSPLAT_KERNEL": "generic"}),
    Limit("NumPy", NUMPY),
    Limit("OpenBLAS", OPENBLAS),
    Limit("OpenCV", OPENCV),
    Limit("PyTorch", TORCH),
    Limit("oneDNN", ONEDNN),
    Limit("MKL", MKL),
    Limit("2 threads", {"OMP_NUM_THREADS": "2", "OMP_WAIT_POLICY": "passive"}),
    Limit("all AVX2", AVX2),
    Limit("all AVX2, chain", AVX2, chain=True),
)


def choices() -> dict[str, str]:
    """The choices of the libraries in this process, if they report them."""
    import cv2
    import numpy as np
    import torch
    from numpy._core._multiarray_umath import __cpu_features__ as features

    from egosplat.rasterize.kernels import library

    return {
        "kernels": library.variant(),
        "NumPy": "AVX-512" if features.get("X86_V4") else "AVX2" if features.get("X86_V3") else "SSE4.2",
        "OpenBLAS": _openblas(Path(np.__file__).parent.with_name("numpy.libs")),
        "OpenCV": "AVX-512" if "*AVX512-SKX" in cv2.getCPUFeaturesLine().split() else "AVX2",
        "PyTorch": torch.backends.cpu.get_cpu_capability(),
        "threads": str(torch.get_num_threads()),
    }


def _openblas(folder: Path) -> str:
    """The kind of processor for which NumPy's OpenBLAS computes."""
    for path in folder.glob("*openblas*"):
        for name in ("scipy_openblas_get_corename64_", "openblas_get_corename"):
            if function := getattr(ctypes.CDLL(str(path)), name, None):
                function.restype = ctypes.c_char_p
                return function().decode()
    return "unknown"
