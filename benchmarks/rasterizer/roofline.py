"""What the machine could do at best: its measured peak, and the operations that a scene needs."""

import ctypes
import subprocess
import tempfile
import time
from pathlib import Path

from egosplat.errors import UserError
from egosplat.kernels.compiling import find_compiler
from egosplat.kernels.targets import VARIANTS

_SOURCE = Path(__file__).with_name("fma.cpp")
_VECTOR_BYTES = {"avx512": 64, "avx2": 32, "generic": 16}
_REPETITIONS = 5_000_000
_TRIES = 9


def flops_per_pair(channels: int) -> int:
    """Operations that a composited (pixel, Gaussian) pair needs, forward and backward.

    Forward 26 + 2 C: offset, sigma, exponential, alpha, transmittance and C multiply-adds. Backward 46 + 4 C: the same
    again, the gradients of sigma, alpha, mean, conic and opacity, and twice C multiply-adds.
    """
    return (26 + 2 * channels) + (46 + 4 * channels)


def peak_gflops(variant: str) -> float:
    """Multiply-adds of one core in float32, with a variant's instructions, the best of some tries [GFLOP/s].

    Raises:
        UserError: there is no compiler.
    """
    compiler = find_compiler()
    if compiler is None:
        raise UserError("the roofline is measured with a C++ compiler: install one (apt install g++)")
    flags = next(each.flags for each in VARIANTS if each.name == variant)
    width = f"-DEGOSPLAT_VECTOR_BYTES={_VECTOR_BYTES[variant]}"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "fma.so")
        command = [*compiler, "-O3", "-fPIC", "-shared", *flags, width, str(_SOURCE), "-o", str(path)]
        subprocess.run(command, check=True)
        function = ctypes.CDLL(str(path)).egosplat_fma
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_long, ctypes.POINTER(ctypes.c_float)]
    return max(_gflops(function) for _ in range(_TRIES))


def _gflops(function: "ctypes._CFuncPtr") -> float:
    numbers = (ctypes.c_float * 2)(0.999, 0.001)
    start = time.process_time()
    done = function(_REPETITIONS, numbers)
    return 1e-9 * done / (time.process_time() - start)
