"""Load the compiled kernels: the best variant that this processor supports.

The number of threads is torch's (``torch.set_num_threads``, OMP_NUM_THREADS).
"""

import ctypes
import functools
import os
from pathlib import Path
from typing import Any

# The libraries link to no OpenMP runtime of their own. They use torch's, which importing torch makes visible
# to all libraries. With two runtimes in one process, the idle threads of each spin on the cores that the
# other needs: alternating kernels and torch operations took 8 ms per pair instead of 0.3 ms on two cores.
import torch  # noqa: F401
from torch import Tensor

from egosplat.errors import UserError, reraise_as
from egosplat.pipeline.home import how_to_reinstall
from egosplat.rasterize.kernels.targets import HERE, VARIANTS, Variant, source_hash

# Version of the functions' signatures, which ``egosplat_abi`` of a library must return.
ABI = 1

# Environment variable that selects a variant, for tests and benchmarks.
VARIABLE = "EGOSPLAT_KERNEL"


# Codes of the argument types of a kernel's function, as ``function`` takes them.
_TYPES = {
    "i": ctypes.c_int,
    "l": ctypes.c_int64,
    "d": ctypes.c_double,
    "p": ctypes.c_void_p,
    "c": ctypes.POINTER(ctypes.c_double),
}


@functools.cache
def function(name: str, arguments: str, result: str = "") -> Any:
    """Get a function of the library by its name, codes of its arguments' types and of its result's
    (UserError: no library is usable; ``why_not`` returns the same message)."""
    found = getattr(_loaded()[1], f"egosplat_{name}")
    found.argtypes = [_TYPES[code] for code in arguments]
    found.restype = _TYPES[result] if result else None
    return found


def plain(tensor: Tensor | None) -> Tensor | None:
    """The numbers of a tensor, contiguous and without gradients; None stays None."""
    return None if tensor is None else tensor.detach().contiguous()


def address(tensor: Tensor | None) -> int | None:
    """Address of the first number; None, the null pointer, stays None."""
    return None if tensor is None else tensor.data_ptr()


def variant() -> str:
    """Name of the loaded variant: avx512, avx2 or generic. Raises as ``function``."""
    return _loaded()[0]


def why_not() -> str | None:
    """The reason why the kernels cannot be used, with a remedy; None if they can."""
    try:
        _loaded()
    except UserError as error:
        return str(error)
    return None


@functools.cache
def is_usable() -> bool:
    """Whether the kernels can be used; cached for the process."""
    return why_not() is None


@functools.cache
def is_compiled() -> bool:
    """Whether a library of any variant exists, usable or not; cached for the process."""
    return any((HERE / variant.file).is_file() for variant in VARIANTS)


def cpu_features(cpuinfo: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """The processor's features, as Linux's /proc/cpuinfo names them; empty on other systems."""
    if not cpuinfo.is_file():
        return frozenset()
    lines = (line.partition(":") for line in cpuinfo.read_text().splitlines())
    return next((frozenset(words.split()) for key, _, words in lines if key.strip() == "flags"), frozenset())


def choose(folder: Path, features: frozenset[str], wanted: str | None) -> Variant:
    """Choose the best variant with a library in ``folder`` for a processor with ``features``, or the one
    ``wanted`` by name (UserError: there is none)."""
    if wanted is not None:
        return _named_variant(folder, features, wanted)
    compiled = [variant for variant in VARIANTS if (folder / variant.file).is_file()]
    if not compiled:
        raise UserError(
            f"The C++ kernels are not compiled (no libegosplat_*.so in {folder}).\n"
            f"Install GCC 12 or newer (apt install g++), then {how_to_reinstall()}"
        )
    for candidate in compiled:
        if candidate.features <= features:
            return candidate
    raise UserError(f"None of the compiled kernels in {folder} runs on this processor: {how_to_reinstall()}")


def open_library(folder: Path, variant: Variant) -> ctypes.CDLL:
    """Load one variant's library from ``folder``; it must be compiled from ``folder / "source"`` (UserError:
    it cannot be loaded, or was compiled from other sources; OSError: the system is out of memory)."""
    path = folder / variant.file

    def unloadable(error: Exception) -> UserError:
        return UserError(f"{path} cannot be loaded ({error}): {how_to_reinstall()}")

    with reraise_as(unloadable, (OSError, AttributeError)):
        library = ctypes.CDLL(str(path))
        library.egosplat_source_hash.restype = ctypes.c_char_p
        compiled_from, abi = library.egosplat_source_hash().decode(), library.egosplat_abi()
    if abi != ABI or compiled_from != source_hash(folder):
        raise UserError(
            f"{path} was compiled from other sources than those in {folder / 'source'}: {how_to_reinstall()}"
        )
    return library


@functools.cache
def _loaded() -> tuple[str, ctypes.CDLL]:
    """Load the best compiled variant that this processor supports, or the one that EGOSPLAT_KERNEL names, once per process."""
    chosen = choose(HERE, cpu_features(), os.environ.get(VARIABLE) or None)
    return chosen.name, open_library(HERE, chosen)


def _named_variant(folder: Path, features: frozenset[str], name: str) -> Variant:
    found = next((variant for variant in VARIANTS if variant.name == name), None)
    if found is None:
        names = ", ".join(variant.name for variant in VARIANTS)
        raise UserError(f"{VARIABLE}={name}: choose one of {names}, or unset it.")
    if missing := found.features - features:
        raise UserError(
            f"{VARIABLE}={name}: the processor lacks {' '.join(sorted(missing))}: choose another, or unset it."
        )
    if not (folder / found.file).is_file():
        raise UserError(f"{VARIABLE}={name}: {folder / found.file} is not compiled; {how_to_reinstall()}")
    return found
