"""How long the main job takes: measured figures, scaled to the configuration.

Measured on two cores of an AMD EPYC (Zen 4, AVX-512) that other work shared, at the presets balanced (120
pictures at 704 filmed, read at 512; 7,000 iterations, 100,000 Gaussians at most) and fast; see
benchmarks/training.md and benchmarks/rasterizer.md.
"""

from dataclasses import dataclass

from egosplat.config import Config

MEASURED_ON = "two cores of an AMD EPYC (Zen 4)"

SYNTHETIC_START_S, SYNTHETIC_PICTURE_S = 10.0, 0.6
"""Building an apartment, and filming one picture of 704x704; 82 s in all for 120 of them."""

READING_START_S, READING_PICTURE_S = 12.0, 0.03
"""Starting frames, annotations, poses and pages, and reading one picture at 512x512."""

ITERATION_S = {"avx512": 0.082, "avx2": 0.1, "generic": 0.26}
"""A training iteration at 512x512 with at most 100,000 Gaussians: 469 to 654 s for 7,000 with avx512. The others
are in the ratio of the rasterizer's benchmark."""

PIXELS_SHARE = 0.3
"""Of an iteration's time, what grows with pixels; the rest grows with Gaussians."""


@dataclass(frozen=True)
class Estimate:
    """Seconds of each part of the main job; None where nothing was measured.

    Attributes:
        synthetic: filming the apartment; 0 where the recording is real.
        reading: frames, annotations and poses.
        splats: training the Gaussians.
    """

    synthetic: float
    reading: float | None
    splats: float | None


def estimate(config: Config, synthetic: bool, rasterizer: str) -> Estimate:
    """Expected seconds of a scene's main job.

    Args:
        config: the scene's whole configuration.
        synthetic: whether its recording is made first. The length of a real one is not known beforehand.
        rasterizer: what renders: the kernels' variant, or anything else, of which no figure is known.
    """
    film, frames, splats = config["synthetic"], config["frames"], config["splats"]
    pictures = film["seconds"] * film["fps"]
    area = (frames["resolution"] / 512) ** 2
    iteration = PIXELS_SHARE * area + (1 - PIXELS_SHARE) * splats["max_gaussians"] / 100_000
    return Estimate(
        SYNTHETIC_START_S + SYNTHETIC_PICTURE_S * pictures * (film["size"] / 704) ** 2 if synthetic else 0.0,
        READING_START_S + READING_PICTURE_S * pictures / frames["stride"] * area if synthetic else None,
        splats["iterations"] * ITERATION_S[rasterizer] * iteration if rasterizer in ITERATION_S else None,
    )


def spoken(seconds: float) -> str:
    """``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
