"""Expected memory and time of a stage, from the sizes of a scene.

A law is a sum of terms, each a coefficient times a product of sizes (see ``sizes``). ``coefficients.json`` holds them:

- ``laws``: by name, the ``source`` of the coefficients, which measures are ``assumed``, and the laws themselves. ``cpu_s`` is processor time on one core
  without a GPU [s], ``peak_memory_mb`` main memory without a GPU [MiB], ``disk_mb`` the artifact's size [MiB]. A term is
  written as its sizes joined by ``*``; ``1`` is the constant. Most laws are fitted to benchmarks/growth/growth.json: small
  synthetic apartments on one thread, and four of full size; the small models, a processor with AVX-512.
- ``busy_cores``: the cores that a stage kept busy on two cores; 1 for stages that are not listed.
- ``rasterizer``: time with each variant of the C++ kernels against AVX-512, from benchmarks/rasterizer/README.md.
- ``gpu_speedup``: time on one core against time on a GPU. **Assumed**; no GPU was measured.
"""

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from egosplat.models.configs import SMALL
from egosplat.pipeline.config import Config

# The names of the sizes that a term multiplies; () is the constant.
Term = tuple[str, ...]

CPU, MEMORY, DISK = "cpu_s", "peak_memory_mb", "disk_mb"

MEASURED_ON = "two cores with AVX-512"

# Start of Python and its libraries, which ``cpu_s`` excludes: 2.7 to 4 s in the log of a whole run.
START_S = 4.0

# Values of language.method whose law has another name: those that train on sampled pixels, also with networks.
_SAMPLED = {"sparse": "sampled", "quantized": "sampled", "granular": "networks", "field": "networks"}

# What the names of laws whose time depends on the rasterizer begin with.
_RENDERS = ("transient", "instances", "splats", "language", "metrics")

# Terms of memory alone: pictures that Gaussians are trained on, and their masks. No more of each are in memory
# (egosplat.gaussians.stored_rows.IN_MEMORY).
_HELD = frozenset(
    {("training", "pixels"), ("training", "pixels", "mask_bytes"), ("training", "initial_pixels")}
)
HELD_MIB = 1536


def law_of(stage: str, config: Config, *, colmap: bool = False) -> str:
    """The name of the law of a stage under a configuration.

    Args:
        stage: one of ``STAGES``.
        colmap: whether poses come from COLMAP; else they are read from the device's trajectory.
    """
    models = config["models"]
    small_clip = models["clip_model"] == SMALL
    if stage == "poses" and colmap:
        return "poses_colmap"
    if stage == "segments" and config["segments"]["segmenter"] == "classical":
        return "segments_classical"
    if stage == "segments" and models["sam2_config"] != SMALL:
        return "segments_published"
    if stage == "language" and config["splats"]["language"] != "joint":
        method = config["language"]["method"]
        return stage if method == "lifted" else f"{stage}_{_SAMPLED.get(method, method)}"
    if stage == "queries_sheet":  # answers queries as metrics does
        stage = "metrics"
    if stage in ("view_features", "metrics") and not small_clip:
        return f"{stage}_published"
    return stage


def memory_mib(law: str, sizes: Mapping[str, float]) -> float:
    """Expected peak of main memory without a GPU [MiB].

    Args:
        law: a name that ``law_of`` returns.
        sizes: of the scene; ``sizes.Sizes`` or a plain mapping.
    """
    return evaluate(laws()[law][MEMORY], sizes)


def seconds(law: str, sizes: Mapping[str, float], rasterizer: str = "avx512") -> float:
    """Expected time on the clock on two cores without a GPU [s].

    Args:
        law, sizes: as in ``memory_mib``.
        rasterizer: the variant of the C++ kernels, ``avx512``, ``avx2`` or ``generic``.
    """
    slower = table()["rasterizer"][rasterizer] if renders(law) else 1.0
    return START_S + slower * evaluate(laws()[law][CPU], sizes) / table()["busy_cores"].get(law, 1.0)


def gpu_seconds(law: str, sizes: Mapping[str, float]) -> float:
    """Time of a stage on a GPU [s]: that of one core divided by an assumed factor, not a measurement."""
    kind = "rasterizer" if renders(law) else "network"
    return START_S + evaluate(laws()[law][CPU], sizes) / table()["gpu_speedup"][kind]


def renders(law: str) -> bool:
    """Whether the time of a law depends on the rasterizer."""
    return law.startswith(_RENDERS)


def evaluate(law: Mapping[Term, float], sizes: Mapping[str, float]) -> float:
    """Evaluate a law; sizes of terms with coefficient 0 may be unknown. Pictures or masks in memory are at most ``HELD_MIB``."""
    return math.fsum(
        min(factor * math.prod(sizes[name] for name in term), HELD_MIB if term in _HELD else math.inf)
        for term, factor in law.items()
        if factor
    )


def is_assumed(law: str, measure: str) -> bool:
    """Whether a measure (``CPU``, ``MEMORY``, ``DISK``) of a law is assumed, not measured."""
    return measure in table()["laws"][law].get("assumed", ())


@cache
def table() -> dict[str, Any]:
    """The content of ``coefficients.json``."""
    return json.loads((Path(__file__).parent / "coefficients.json").read_text())


@cache
def laws() -> dict[str, dict[str, dict[Term, float]]]:
    """The coefficients of all laws: by name, by measure (``CPU``, ``MEMORY``, ``DISK``), by term."""
    return {
        name: {
            measure: {_term(text): factor for text, factor in law.items()}
            for measure, law in entry.items()
            if measure in (CPU, MEMORY, DISK)
        }
        for name, entry in table()["laws"].items()
    }


def _term(text: str) -> Term:
    return () if text == "1" else tuple(text.split("*"))
