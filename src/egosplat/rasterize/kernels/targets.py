"""The variants of the compiled kernels, one for each instruction set."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from egosplat.pipeline.code_hash import cpp_hash

# Folder of the libraries and of ``source``, their source code.
HERE = Path(__file__).parent

# Flags of every variant. Without ``-ffast-math``, so that sums keep their order.
FLAGS = ("-O3", "-std=c++17", "-fopenmp", "-fPIC", "-fno-math-errno", "-fno-trapping-math")


@dataclass(frozen=True)
class Variant:
    """Compiler flags for one instruction set.

    Attributes:
        name: part of the library's name.
        flags: compiler flags in addition to ``FLAGS``.
        features: required processor features, as /proc/cpuinfo names them.
    """

    name: str
    flags: tuple[str, ...]
    features: frozenset[str]

    @property
    def file(self) -> str:
        """Name of its library."""
        return f"libegosplat_{self.name}.so"


_V3 = frozenset({"avx2", "bmi1", "bmi2", "fma", "f16c", "movbe", "abm"})
_V4 = _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}

# Ordered from best to worst; the last one runs on any processor.
VARIANTS = (
    Variant("avx512", ("-march=x86-64-v4", "-mprefer-vector-width=512"), _V4),
    Variant("avx2", ("-march=x86-64-v3",), _V3),
    Variant("generic", (), frozenset()),
)


def source_hash(folder: Path = HERE) -> str:
    """Hash of the sources below ``folder`` and of the flags they are compiled with; 16 hexadecimal digits.

    Each library contains the hash of its own sources (``egosplat_source_hash``).
    """
    flags = repr((FLAGS, [(variant.name, variant.flags) for variant in VARIANTS]))
    return hashlib.sha256(f"{cpp_hash(folder / 'source')}\0{flags}".encode()).hexdigest()[:16]
