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


# What the methods of others took on one scene (docs/methods.md): its views, pixels, Gaussians, and numbers in a code of
# whole features.
_METHODS = "docs/methods.md: a scene of 101 views of 512 x 512 and 100,000 Gaussians"
_VIEWS, _PIXELS, _GAUSSIANS, _CODES = 101, 512**2, 100_000, 384

# Peak memory of language without Gaussians and codes [MiB].
_LANGUAGE_MB = 650.0


def _means(seconds: float, memory_mb: float) -> Law:
    """Codes in one pass over the views."""
    held = _GAUSSIANS * _CODES
    return Law(
        _METHODS,
        {("training", "gaussians", "codes"): seconds / (_VIEWS * held)},
        {ONCE: _LANGUAGE_MB, ("gaussians", "codes"): (memory_mb - _LANGUAGE_MB) / held},
        (MEMORY,),
    )


def _sampled(seconds: float, pixels: int) -> Law:
    """Codes that are trained on sampled pixels; ``seconds`` of an iteration."""
    memory = {ONCE: _LANGUAGE_MB, ("gaussians",): (1536 - _LANGUAGE_MB) / _GAUSSIANS}
    return Law(_METHODS, {("language_iterations", "sampled"): seconds / pixels}, memory, (MEMORY,))


# Two images of codes; of each Gaussian's code its value, gradient and Adam's two means.
_TRAINED_MEMORY = {
    ONCE: _LANGUAGE_MB,
    ("pixels", "codes"): 8 * PIXEL,
    ("gaussians",): 4 * KB,
    ("gaussians", "codes"): 16 * PIXEL,
}

_SHEET = Law("a few figures", {ONCE: 100.0}, {ONCE: 334.0, ("pixels",): 300 * PIXEL}, (CPU, MEMORY))
_RENDERED_SHEET = Law(
    "figures of rendered views", {ONCE: 100.0}, {ONCE: 1145.0, ("gaussians",): KB}, (CPU, MEMORY)
)

# Laws of what the growth benchmark does not run.
LAWS: Mapping[str, Law] = {
    "synthetic": Law(
        "704 x 704: 0.545 CPU-s a frame with an ideal camera, 1.8 with a real one; 858 MiB with a real one on two threads",
        {ONCE: 4.0, ("filmed_frames", "filmed_pixels"): 0.545 / 704**2},
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
    "language_projected": _means(6.0, 1126.0),
    "language_center": _means(24.0, 1331.0),
    "language_clustered": _means(156.0, 2560.0),
    "language_trained": Law(
        _METHODS + ", codes of 9 numbers",
        {("language_iterations", "pixels", "codes"): 0.12 / (_PIXELS * 9)},
        _TRAINED_MEMORY,
        (MEMORY,),
    ),
    "language_sampled": _sampled(0.11, 8192),
    "language_networks": _sampled(0.58, 8192),
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
            ("images",): published["picture"],
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
