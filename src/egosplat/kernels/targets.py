"""The variants in which the kernels are compiled, one for each set of processor instructions."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from egosplat.pipeline.source_hash import cpp_hash

HERE = Path(__file__).parent
"""Where the sources lie, in the folder ``source``, and where their libraries do."""

FLAGS = ("-O3", "-std=c++17", "-fopenmp", "-fPIC", "-fno-math-errno", "-fno-trapping-math")
"""What every variant is compiled with. Not ``-ffast-math``: sums keep their order."""


@dataclass(frozen=True)
class Variant:
    """One way to compile the kernels.

    Attributes:
        name: what it is called, in the library's name too.
        flags: the compiler's flags beside ``FLAGS``.
        features: what the processor must offer, in the words of /proc/cpuinfo.
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

VARIANTS = (
    Variant("avx512", ("-march=x86-64-v4", "-mprefer-vector-width=512"), _V4),
    Variant("avx2", ("-march=x86-64-v3",), _V3),
    Variant("generic", (), frozenset()),
)
"""The best first; the last one runs anywhere."""


def source_hash(folder: Path = HERE) -> str:
    """Hash of the sources below ``folder`` and of the flags they are compiled with; 16 hexadecimal digits.

    Each library carries the hash that it was compiled from (``egosplat_source_hash``).
    """
    flags = repr((FLAGS, [(variant.name, variant.flags) for variant in VARIANTS]))
    return hashlib.sha256(f"{cpp_hash(folder / 'source')}\0{flags}".encode()).hexdigest()[:16]
