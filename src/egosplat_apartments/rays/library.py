"""Load the compiled ray caster: one library for all processors, because results must be equal on all of them."""

import ctypes
import functools
import hashlib
from pathlib import Path

from egosplat.errors import UserError, reraise_as
from egosplat.pipeline.code_hash import cpp_hash
from egosplat.pipeline.home import how_to_reinstall

# The folder of the library and, in ``source``, of its sources.
HERE = Path(__file__).parent

LIBRARY = "libegosplat_rays.so"

# No instruction set and no fused multiply-add: both would change the last bit.
FLAGS = ("-O3", "-std=c++17", "-fPIC", "-ffp-contract=off")

_POINTER, _LONG = ctypes.c_void_p, ctypes.c_int64


def source_hash(folder: Path = HERE) -> str:
    """Hash of the sources below ``folder`` and of their flags; 16 hexadecimal digits. The library contains it."""
    return hashlib.sha256(f"{cpp_hash(folder / 'source')}\0{FLAGS!r}".encode()).hexdigest()[:16]


@functools.cache
def load() -> ctypes.CDLL:
    """Load the library with declared function types, once per process.

    Raises:
        UserError: it is not compiled, cannot be loaded, or was compiled from other sources.
    """
    path = HERE / LIBRARY
    if not path.is_file():
        raise UserError(
            f"The ray caster of synthetic recordings is not compiled ({path} is missing).\n"
            f"Install a C++17 compiler (apt install g++), then {how_to_reinstall()}"
        )
    library = open_library(path)
    if library.rays_source_hash().decode() != source_hash():
        raise UserError(
            f"{path} was compiled from other sources than those in {HERE / 'source'}: {how_to_reinstall()}"
        )
    return library


def open_library(path: Path) -> ctypes.CDLL:
    """Load a compiled ray caster and declare its functions.

    Raises:
        UserError: it cannot be loaded.
        OSError: the system is out of memory.
    """

    def unloadable(error: Exception) -> UserError:
        return UserError(f"{path} cannot be loaded ({error}): {how_to_reinstall()}")

    with reraise_as(unloadable, (OSError, AttributeError)):
        library = ctypes.CDLL(str(path))
        library.rays_source_hash.restype = ctypes.c_char_p
        library.rays_build.restype = _POINTER
        library.rays_build.argtypes = [_POINTER, _POINTER, _LONG]
        library.rays_free.restype = None
        library.rays_free.argtypes = [_POINTER]
        library.rays_cast.restype = None
        library.rays_cast.argtypes = [_POINTER, _LONG, _POINTER, _LONG, *[_POINTER] * 5]
        library.rays_blocked.restype = None
        library.rays_blocked.argtypes = [_POINTER, _LONG, _POINTER, _LONG, *[_POINTER] * 3]
    return library
