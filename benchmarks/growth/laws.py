"""The terms of each stage's law; their coefficients are fitted to the measured runs."""

from collections.abc import Mapping

from benchmarks.growth.fitting import Fit, fit
from benchmarks.growth.readings import Run
from egosplat.cost_model.laws import CPU, DISK, MEMORY, Term

ONCE: Term = ()

# By stage and measure. A term stands for a loop in the stage's code.
LAWS: Mapping[str, Mapping[str, tuple[Term, ...]]] = {
    "frames": {
        CPU: (("frames",), ("frames", "recorded_pixels"), ("frames", "pixels")),
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
        CPU: (("images",), ("prompts",), ("kept", "tracked", "sam2_area"), ("kept", "moving"), ("kept", "pixels")),
        MEMORY: (ONCE, ("tracked", "sam2_area"), ("pixels",), ("kept", "pixels")),
        DISK: (ONCE, ("labeled", "pixels")),
    },
    "instances": {
        CPU: (
            ("merging_iterations",),
            ("merging_iterations", "merging_pixels"),
            ("masks",),
            ("merged_views", "merging_pixels"),
            ("frames", "pixels"),
        ),
        MEMORY: (ONCE, ("merging_gaussians",), ("masks",), ("runs",), ("pixels",)),
        DISK: (ONCE, ("frames", "pixels"), ("merging_gaussians",)),
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
            ONCE,
            ("initial_iterations",),
            ("initial_iterations", "initial_pixels"),
            ("initial_iterations", "initial_gaussians"),
            ("network_iterations", "network_pixels"),
            ("frames", "pixels"),
        ),
        MEMORY: (ONCE, ("training", "initial_pixels"), ("initial_pixels",), ("large_initial_pixels",), ("initial_gaussians",), ("network_pixels",), ("pixels",)),
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
            ("iterations", "corrected"),
            ("iterations", "pixels", "corrected"),
            ("iterations", "pixels", "joint"),
            ("iterations", "mean_gaussians", "joint"),
        ),
        MEMORY: (ONCE, ("training", "pixels"), ("training", "pixels", "mask_bytes"), ("pixels",), ("gaussians",), ("pixels", "joint"), ("gaussians", "joint")),
        DISK: (ONCE, ("gaussians",), ("gaussians", "joint"), ("evaluated", "pixels"), ("evaluated", "pixels", "corrected")),
    },
    "language": {
        CPU: (ONCE, ("training", "pixels"), ("training", "gaussians"), ("views", "pixels"), ("views", "gaussians")),
        MEMORY: (ONCE, ("pixels", "shown"), ("gaussians", "shown"), ("gaussians", "codes")),
        DISK: (ONCE, ("gaussians", "codes")),
    },
    "metrics": {
        CPU: (ONCE, ("evaluated", "pixels"), ("queries", "pixels"), ("gaussians",), ("queries", "gaussians")),
        MEMORY: (ONCE, ("pixels",), ("gaussians",)),
        DISK: (ONCE, ("queries",)),
    },
}  # fmt: skip

# One byte a pixel [MiB].
BYTE = 1 / 2**20

# By stage and measure: coefficients that follow from the code and are not fitted.
KNOWN: Mapping[tuple[str, str], Mapping[Term, float]] = {
    # Training frames take three bytes per pixel and their masks one or two, features four copies of float32. All are
    # too small in the measured scenes to be fitted: the fit would confuse a view's features with its share of the batches.
    # In small scenes a render of transient hides in the memory of the network. At 1408 px the stage took 3.6 GiB
    # (benchmarks/long_recording): 520 bytes more for each pixel than the fit.
    ("transient", MEMORY): {
        ("training", "initial_pixels"): 3 * BYTE,
        ("large_initial_pixels",): 520 * BYTE,
    },
    ("splats", MEMORY): {("training", "pixels"): 3 * BYTE, ("training", "pixels", "mask_bytes"): BYTE},
    ("view_features", MEMORY): {("views", "channels"): 16 * BYTE},
    # Labels wait in memory for the end of the stage, compressed to a hundredth of 12 bytes for each pixel.
    ("segments", MEMORY): {("kept", "pixels"): 0.12 * BYTE},
    # Of a mask its votes and its part of what frames have seen: 18,500 more masks took 1.24 GiB more (benchmarks/instances).
    ("instances", MEMORY): {("masks",): 7e4 * BYTE},
    # Codes of all Gaussians three times; the design has codes of one length alone.
    ("language", MEMORY): {("gaussians", "codes"): 12 * BYTE},
}


def fit_all(runs: list[Run]) -> dict[str, dict[str, Fit]]:
    """The laws of all measured stages, by stage and measure."""
    found: dict[str, dict[str, Fit]] = {}
    for stage, laws in LAWS.items():
        own = [run for run in runs if run.stage == stage]
        found[stage] = {
            measure: fit(
                terms,
                [run.sizes for run in own],
                [getattr(run, measure) for run in own],
                KNOWN.get((stage, measure)),
            )
            for measure, terms in laws.items()
        }
    return found
