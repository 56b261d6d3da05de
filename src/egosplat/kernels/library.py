"""The compiled kernels: the library of the best variant that this processor runs.

Our libraries name no OpenMP runtime of their own: they resolve to torch's, which importing torch makes
visible to all libraries. With two runtimes in one process, each one's idle threads spin on the processors
that the other needs: kernels and torch operations in turn, 0.3 ms a pair on two cores, took 8 ms a pair. So
the number of threads is torch's, too (``torch.set_num_threads``, OMP_NUM_THREADS).
"""

import ctypes
import functools
import os
from pathlib import Path

import torch  # noqa: F401  before the libraries, which need its OpenMP runtime

from egosplat.errors import UserError, reraise_as
from egosplat.kernels.targets import HERE, VARIANTS, Variant, source_hash

ABI = 1
"""Version of the functions' signatures: what ``egosplat_abi`` of a library must return."""

VARIABLE = "EGOSPLAT_KERNEL"
"""Environment variable that names the variant to load, for tests and benchmarks."""

_AGAIN = "run make install, or pip install --no-build-isolation --no-deps -e ."


def load() -> ctypes.CDLL:
    """The library of the best variant that this processor runs and that is compiled, or of EGOSPLAT_KERNEL's.

    Loaded once a process. Who uses a function declares its argument types.

    Raises:
        UserError: no library is usable; the message is ``why_not``'s.
    """
    return _loaded()[1]


def variant() -> str:
    """Name of the loaded variant: avx512, avx2 or generic. Raises as ``load`` does."""
    return _loaded()[0]


def why_not() -> str | None:
    """Why the kernels cannot be used, and what to do; None where they can."""
    try:
        load()
    except UserError as error:
        return str(error)
    return None


@functools.cache
def is_usable() -> bool:
    """Whether the kernels can be used; found out once a process."""
    return why_not() is None


def is_compiled() -> bool:
    """Whether a library of any variant lies here, usable or not."""
    return any((HERE / variant.file).is_file() for variant in VARIANTS)


def cpu_features(cpuinfo: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """What the processor offers, in the words of Linux's /proc/cpuinfo; empty where that says nothing."""
    if not cpuinfo.is_file():
        return frozenset()
    lines = (line.partition(":") for line in cpuinfo.read_text().splitlines())
    return next((frozenset(words.split()) for key, _, words in lines if key.strip() == "flags"), frozenset())


def choose(folder: Path, features: frozenset[str], wanted: str | None) -> Variant:
    """The best variant whose library lies in ``folder`` and that a processor with ``features`` runs.

    Args:
        folder: where the libraries lie.
        features: what the processor offers, see ``cpu_features``.
        wanted: name of the only variant to consider; None for any.

    Raises:
        UserError: there is none.
    """
    if wanted is not None:
        return _wanted(folder, features, wanted)
    compiled = [variant for variant in VARIANTS if (folder / variant.file).is_file()]
    if not compiled:
        raise UserError(
            f"The C++ kernels are not compiled (no libegosplat_*.so in {folder}).\n"
            f"Install a C++17 compiler with OpenMP (apt install g++), then {_AGAIN}"
        )
    for candidate in compiled:
        if candidate.features <= features:
            return candidate
    raise UserError(f"None of the compiled kernels in {folder} runs on this processor: {_AGAIN}")


def open_library(folder: Path, variant: Variant) -> ctypes.CDLL:
    """Load one variant's library from ``folder``, whose folder ``source`` it must be compiled from.

    Raises:
        UserError: it cannot be loaded, or was compiled from other sources.
        OSError: the system refuses the memory for it.
    """
    path = folder / variant.file

    def tell(error: Exception) -> UserError:
        return UserError(f"{path} cannot be loaded ({error}): {_AGAIN}")

    with reraise_as(tell, (OSError, AttributeError)):
        library = ctypes.CDLL(str(path))
        library.egosplat_source_hash.restype = ctypes.c_char_p
        compiled_from, abi = library.egosplat_source_hash().decode(), library.egosplat_abi()
    if abi != ABI or compiled_from != source_hash(folder):
        raise UserError(f"{path} was compiled from other sources than those beside it: {_AGAIN}")
    return library


@functools.cache
def _loaded() -> tuple[str, ctypes.CDLL]:
    chosen = choose(HERE, cpu_features(), os.environ.get(VARIABLE) or None)
    return chosen.name, open_library(HERE, chosen)


def _wanted(folder: Path, features: frozenset[str], name: str) -> Variant:
    found = next((variant for variant in VARIANTS if variant.name == name), None)
    if found is None:
        names = ", ".join(variant.name for variant in VARIANTS)
        raise UserError(f"{VARIABLE}={name}: choose one of {names}, or unset it.")
    if missing := found.features - features:
        raise UserError(
            f"{VARIABLE}={name}: the processor lacks {' '.join(sorted(missing))}: choose another, or unset it."
        )
    if not (folder / found.file).is_file():
        raise UserError(f"{VARIABLE}={name}: {folder / found.file} is not compiled; {_AGAIN}")
    return found
