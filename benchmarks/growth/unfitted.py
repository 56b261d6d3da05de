"""Coefficients of the cost model that are not fitted to the measured points, with their sources."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.fitting import Fit
from benchmarks.growth.laws import ONCE
from egosplat.cost_model.laws import CPU, MEMORY, Term

# Peak memory with the paper's models, without tracked instances (benchmarks/published_models/README.md)
# [MiB].
SAM2_MB, CLIP_MB = 1861.0, 1922.0

# Of an instance that SAM2 tracks at 1024 px: 1.9 at 320 px (benchmarks/segments_growth/README.md), by area
# [MiB].
TRACKED_MB = 19.2

# ``segments.lost_track_stride``: a lost instance is searched for in every third frame.
ABSENT_STRIDE = 3

# Processor time / time on the clock of the stages of adt/scene1 on two cores; other stages keep one core
# busy.
BUSY_CORES = {
    "segments": 1.3,
    "segments_published": 1.3,
    "splats": 1.6,
    "poses_colmap": 1.8,
    "synthetic": 1.6,
}

# Time of a training step with each variant of the kernels against AVX-512 (benchmarks/rasterizer/README.md).
RASTERIZER = {"avx512": 1.0, "avx2": 1.22, "generic": 3.2}

# 1,000 bytes and 1 byte [MiB].
KB, PIXEL = 1e3 / 2**20, 1 / 2**20


@dataclass(frozen=True)
class Law:
    """A law with the source of its coefficients, and the measures that are assumed."""

    source: str
    cpu_s: Mapping[Term, float]
    peak_memory_mb: Mapping[Term, float]
    assumed: tuple[str, ...] = ()


_SHEET = Law("a few figures", {ONCE: 100.0}, {ONCE: 334.0, ("pixels",): 300 * PIXEL}, (CPU, MEMORY))
_RENDERED_SHEET = Law(
    "figures of rendered views", {ONCE: 100.0}, {ONCE: 1145.0, ("gaussians",): KB}, (CPU, MEMORY)
)

# Laws of what the growth benchmark does not run.
LAWS: Mapping[str, Law] = {
    "synthetic": Law(
        "120 frames of 704 x 704: 117 CPU-s with an ideal camera; 858 MiB with a real one on two threads",
        {ONCE: 10.0, ("filmed_frames", "filmed_pixels"): 0.9 / 704**2},
        {ONCE: 334.0, ("filmed_pixels",): 1150 * PIXEL},
    ),
    "poses_colmap": Law(
        "time: benchmarks/colmap/README.md, 120 frames of 512 x 512; memory: 8 threads",
        {("frames", "pixels"): 5.0 / 512**2},
        {ONCE: 2861.0, ("pixels",): 8 * 400 * PIXEL, ("frames",): 4.0},
        (MEMORY,),
    ),
    "segments_classical": Law(
        "memory: two synthetic scenes of 96 x 96 and 1024 x 1024; time: as the small SAM2",
        {("kept",): 0.18, ("kept", "tracked"): 0.016},
        {ONCE: 830.0, ("pixels",): 200 * PIXEL},
        (CPU,),
    ),
    "instances": Law(
        "one run: 113 kept frames of 512 x 512, masks of 51 of them: 81 CPU-s, 1,225 MiB",
        {ONCE: 10.0, ("kept", "pixels"): 0.62 / 512**2},
        # Bytes of a kept frame: benchmarks/instances/README.md
        {ONCE: 1000.0, ("kept",): 1.3e6 * PIXEL, ("pixels",): 640 * PIXEL},
        (MEMORY,),
    ),
    "contact_sheet": _SHEET,
    "instances_sheet": _SHEET,
    "crops_sheet": _SHEET,
    "splats_sheet": _SHEET,
    "transient_sheet": _RENDERED_SHEET,
    "language_sheet": _RENDERED_SHEET,
}


def with_paper_models(
    fits: Mapping[str, Mapping[str, Fit]], published: Mapping[str, float], assumed: Assumptions
) -> dict[str, dict[str, Fit]]:
    """The laws with the paper's models instead of the small ones: measured unit costs replace fitted coefficients.

    Instances of the first frame are tracked forwards alone: in each frame where they are seen, else in every third.
    """
    searched = assumed.visible + (1 - assumed.visible) / ABSENT_STRIDE
    clip_mb = CLIP_MB - fits["view_features"][MEMORY].coefficients[ONCE]
    units: dict[tuple[str, str], dict[Term, float]] = {
        ("segments", CPU): {
            ("kept", "sam2_area"): published["picture"],
            ("prompts",): published["prompt"],
            ("kept", "tracked", "sam2_area"): published["tracked"] * searched,
        },
        ("segments", MEMORY): {ONCE: SAM2_MB, ("tracked", "sam2_area"): TRACKED_MB},
        ("view_features", CPU): {("views",): published["crop"]},
        ("view_features", MEMORY): {ONCE: CLIP_MB},
        ("metrics", MEMORY): {ONCE: fits["metrics"][MEMORY].coefficients[ONCE] + clip_mb},
    }
    found = {stage: dict(laws) for stage, laws in fits.items()}
    for (stage, measure), known in units.items():
        law = found[stage][measure]
        found[stage][measure] = replace(
            law,
            coefficients={**law.coefficients, **known},
            without=tuple({**one, **known} for one in law.without),
        )
    return found


def trained_language(lifted: Mapping[str, Mapping[Term, float]]) -> Law:
    """Codes that are trained: after lifting, each iteration costs a view's lifting, and gradients as much memory again."""
    steps = {
        tuple("language_iterations" if name == "training" else name for name in term): factor
        for term, factor in lifted[CPU].items()
        if "training" in term
    }
    memory = {term: factor * (2 if term else 1) for term, factor in lifted[MEMORY].items()}
    return Law("an iteration costs the lifting of a view", {**lifted[CPU], **steps}, memory, (CPU, MEMORY))
