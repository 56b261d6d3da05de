"""Compile the kernels and the ray caster during installation (setup.py)."""

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from egosplat.files import atomic_file
from egosplat.rasterize.kernels.targets import FLAGS, VARIANTS, Variant, source_hash
from egosplat_apartments.rays import library as rays

COMPILERS = ("g++", "c++", "clang++")

NO_COMPILER = (
    "egosplat is installed without its C++ kernels: {}. Install GCC 12 or newer (on Debian and Ubuntu: apt install g++; "
    "where that is older, apt install g++-12, and set CXX=g++-12), then install egosplat again."
)

# What the kernels need of a compiler beside C++17: OpenMP, and shuffles of vectors, which GCC has from version 12 on.
NEEDED = """#include <omp.h>
typedef float Pair __attribute__((vector_size(8)));
Pair swap(Pair a) { return __builtin_shufflevector(a, a, 1, 0); }
"""


def compile_kernels(folder: Path, output: Path, variants: Sequence[Variant] = VARIANTS) -> list[str]:
    """Compile the sources in ``folder / "source"`` into one library per variant, in ``output``.

    A library that was compiled from the same sources by the same command is kept. The environment
    variables CXX and CXXFLAGS name the compiler and more flags, as usual.

    Returns:
        Messages for the user, one line each: variants that the compiler does not support, or a missing
        compiler, which is not an error. An unsupported variant leaves no library behind.

    Raises:
        RuntimeError: the sources do not compile; contains the compiler's output.
    """
    sources = source_hash(folder)
    for variant in variants:
        _remove_older(output / variant.file, sources)
    compiler = find_compiler()
    if compiler is None:
        return [NO_COMPILER.format("no C++ compiler is found")]
    if problem := _flag_error(compiler, FLAGS, NEEDED):
        return [NO_COMPILER.format(f"{shlex.join(compiler)} is too old, or has no OpenMP ({problem})")]
    unknown = {variant: _flag_error(compiler, variant.flags) for variant in variants}
    known = [variant for variant in variants if not unknown[variant]]
    output.mkdir(parents=True, exist_ok=True)
    unit = folder / "source" / "kernels.cpp"
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # ``list`` waits for all and raises the first error.
        list(
            pool.map(
                lambda variant: _compile(
                    compiler, unit, output / variant.file, (*FLAGS, *variant.flags), sources
                ),
                known,
            )
        )
    return [
        f"kernels: variant {variant.name} is not compiled ({problem})"
        for variant, problem in unknown.items()
        if problem
    ]


def compile_rays(folder: Path, output: Path) -> list[str]:
    """Compile the ray caster's sources in ``folder / "source"`` into its one library, in ``output``.

    Existing libraries, the compiler, messages and errors are handled as in ``compile_kernels``.
    """
    library, sources = output / rays.LIBRARY, rays.source_hash(folder)
    _remove_older(library, sources)
    compiler = find_compiler()
    if compiler is None:
        return [NO_COMPILER.format("no C++ compiler is found")]
    output.mkdir(parents=True, exist_ok=True)
    _compile(compiler, folder / "source" / "rays.cpp", library, rays.FLAGS, sources)
    return []


def find_compiler() -> list[str] | None:
    """The C++ compiler's command with the user's flags, from CXX and CXXFLAGS; None if there is none."""
    flags = shlex.split(os.environ.get("CXXFLAGS", ""))
    chosen = shlex.split(os.environ.get("CXX", ""))
    candidates = [chosen] if chosen else [[name] for name in COMPILERS]
    return next(([*command, *flags] for command in candidates if shutil.which(command[0])), None)


def _remove_older(library: Path, sources: str) -> None:
    """Remove a library compiled from other sources, so that it is not loaded if compilation fails."""
    if library.is_file() and sources.encode() not in library.read_bytes():
        library.unlink()


def _flag_error(compiler: list[str], flags: Sequence[str], source: str = "") -> str | None:
    """The compiler's error about flags, in one line; None if it accepts them."""
    command = [*compiler, *flags, "-fsyntax-only", "-x", "c++", "-"]
    done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return None
    return next((line for line in done.stderr.splitlines() if "error" in line), f"status {done.returncode}")


def _compile(compiler: list[str], unit: Path, library: Path, flags: Sequence[str], sources: str) -> None:
    command = [*compiler, "-w", *flags, f'-DEGOSPLAT_SOURCE_HASH="{sources}"']
    identity = hashlib.sha256(repr((command, sources)).encode()).hexdigest()[:40]
    if library.is_file() and bytes.fromhex(identity) in library.read_bytes():
        library.touch()  # so that make sees it as newer than its sources
        return
    with tempfile.TemporaryDirectory() as scratch, atomic_file(library) as path:
        compiled, linked = Path(scratch, "unit.o"), Path(scratch, library.name)
        _call([*command, "-c", str(unit), "-o", str(compiled)])
        # No -fopenmp here: the library must not bring its own OpenMP runtime, see egosplat.rasterize.kernels.library.
        _call([*compiler, "-shared", f"-Wl,--build-id=0x{identity}", str(compiled), "-o", str(linked)])
        shutil.copyfile(linked, path)


def _call(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(command)}\n{done.stderr}")
