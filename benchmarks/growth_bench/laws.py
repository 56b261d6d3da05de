"""What the cost of each stage is made of, as terms of a law; the coefficients are fitted."""

from collections.abc import Mapping

from growth_bench.fitting import Fit, Term, fit
from growth_bench.readings import Run

CPU, MEMORY, DISK = "cpu_s", "peak_memory_mb", "disk_mb"

ONCE: Term = ()

LAWS: Mapping[str, Mapping[str, tuple[Term, ...]]] = {
    "frames": {
        CPU: (("frames", "recorded_pixels"), ("frames", "pixels")),
        MEMORY: (ONCE, ("recorded_pixels",), ("pixels",)),
        DISK: (("frames", "pixels"), ONCE),
    },
    "annotations": {
        CPU: (ONCE, ("evaluated", "recorded_pixels"), ("evaluated", "pixels")),
        MEMORY: (ONCE, ("recorded_pixels",), ("pixels",)),
        DISK: (("evaluated", "pixels"), ONCE),
    },
    "poses": {
        CPU: (("points",), ("frames",)),
        MEMORY: (ONCE, ("frames",)),
        DISK: (("points",), ("frames",)),
    },
    "survey": {
        CPU: (("pairs",), ("pairs", "surveyed_pixels"), ("frames",)),
        MEMORY: (ONCE, ("pixels",)),
        DISK: (ONCE, ("frames",), ("pairs",)),
    },
    "segments": {
        CPU: (("kept",), ("prompts",), ("kept", "followed"), ("kept", "pixels")),
        MEMORY: (ONCE, ("followed",), ("pixels",), ("kept", "pixels")),
        DISK: (ONCE, ("kept", "pixels"), ("kept", "instances")),
    },
    "view_features": {
        CPU: (ONCE, ("views",), ("views", "pixels")),
        MEMORY: (ONCE, ("views", "channels"), ("pixels",)),
        DISK: (ONCE, ("views", "channels")),
    },
    "features": {
        CPU: (ONCE, ("views", "channels"), ("autoencoder",), ("views", "epochs")),
        MEMORY: (ONCE, ("views", "channels"), ("autoencoder",)),
        DISK: (ONCE, ("views", "channels"), ("autoencoder",)),
    },
    "transient": {
        CPU: (
            ("initial_iterations",),
            ("initial_iterations", "initial_pixels"),
            ("initial_iterations", "initial_gaussians"),
            ("network_iterations", "network_pixels"),
            ("frames", "pixels"),
        ),
        MEMORY: (ONCE, ("training", "initial_pixels"), ("initial_pixels",), ("initial_gaussians",), ("network_pixels",), ("pixels",)),
        DISK: (ONCE, ("frames", "pixels")),
    },
    "masks": {
        CPU: (ONCE, ("frames", "pixels")),
        MEMORY: (ONCE, ("pixels",)),
        DISK: (ONCE, ("frames", "pixels")),
    },
    "splats": {
        CPU: (
            ("iterations",),
            ("iterations", "pixels"),
            ("iterations", "mean_gaussians"),
            ("iterations", "pixels", "joint"),
            ("iterations", "mean_gaussians", "joint"),
        ),
        MEMORY: (ONCE, ("training", "pixels"), ("pixels",), ("gaussians",), ("pixels", "joint"), ("gaussians", "joint")),
        DISK: (ONCE, ("gaussians",), ("gaussians", "joint"), ("evaluated", "pixels")),
    },
    "language": {
        CPU: (ONCE, ("training", "pixels", "codes"), ("training", "gaussians", "codes"), ("training", "gaussians")),
        MEMORY: (ONCE, ("pixels", "codes"), ("gaussians", "codes")),
        DISK: (ONCE, ("gaussians", "codes")),
    },
    "metrics": {
        CPU: (ONCE, ("evaluated", "pixels"), ("queries", "pixels"), ("evaluated", "gaussians")),
        MEMORY: (ONCE, ("pixels",), ("gaussians",)),
        DISK: (ONCE, ("queries",)),
    },
}  # fmt: skip
"""By stage and measure. A term is there where the stage's code has a loop over it."""

PICTURE = 3 / 2**20
"""Of a pixel of a training picture, which is held as three bytes [MiB]."""

LEAST: Mapping[tuple[str, str], Mapping[Term, float]] = {
    ("transient", MEMORY): {("training", "initial_pixels"): PICTURE},
    ("splats", MEMORY): {("training", "pixels"): PICTURE},
}
"""By stage and measure: what a coefficient is at least, where the code says so and small sizes hardly show it."""


def fit_all(runs: list[Run]) -> dict[str, dict[str, Fit]]:
    """The laws of all stages that were measured, by stage and measure."""
    found: dict[str, dict[str, Fit]] = {}
    for stage, laws in LAWS.items():
        own = [run for run in runs if run.stage == stage]
        found[stage] = {
            measure: fit(
                terms,
                [run.sizes for run in own],
                [getattr(run, measure) for run in own],
                LEAST.get((stage, measure)),
            )
            for measure, terms in laws.items()
        }
    return found
