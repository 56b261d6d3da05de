"""How long the main job takes: measured figures, scaled to the configuration.

Measured on two cores with AVX-512 that other work shared, at the preset balanced (120 pictures at 704 filmed, read at
512; 100,000 Gaussians at most); see benchmarks/training.md, benchmarks/rasterizer.md and docs/scale.md.
"""

from dataclasses import dataclass

from egosplat.models.configs import SMALL, sam2_side
from egosplat.pipeline.config import Config

MEASURED_ON = "two cores with AVX-512"

SYNTHETIC_START_S, SYNTHETIC_PICTURE_S = 10.0, 0.6
"""Building an apartment, and filming one picture of 704x704; 82 s in all for 120 of them."""

READING_START_S, READING_PICTURE_S = 12.0, 0.03
"""Starting frames, annotations, poses and pages, and reading one picture at 512x512."""

ITERATION_S = {"avx512": 0.082, "avx2": 0.1, "generic": 0.26}
"""A training iteration at 512x512 with at most 100,000 Gaussians: 469 to 654 s for 7,000 with avx512. The others
are in the ratio of the rasterizer's benchmark."""

PIXELS_SHARE = 0.3
"""Of an iteration's time, what grows with pixels; the rest grows with Gaussians."""

SEGMENTS_SIDE, SEGMENTS_PICTURE_S = 320, 2.6
"""The small SAM2 at 320x320 [px], about 70 instances, each way."""

TRANSIENT_ITERATION_S = 0.085
"""At the default sizes, on one thread: a third each for the network, for Gaussians, and for what is always done."""

ASKING_START_S, ASKING_PICTURE_S = 70.0, 0.6
"""Lifting of codes, asking and scoring at 512x512, and the pages."""


@dataclass(frozen=True)
class Estimate:
    """Seconds of each part of the main job; 0 where it is not needed, None where nothing was measured.

    Attributes:
        synthetic: filming the apartment; 0 where the recording is real.
        reading: frames, annotations and poses.
        segments: finding and following instances.
        transient: the network; 0 where nothing is masked.
        splats: training the Gaussians.
        asking: giving them their meaning, asking, scoring.
    """

    synthetic: float
    reading: float | None
    segments: float | None
    transient: float | None
    splats: float | None
    asking: float | None


def estimate(config: Config, synthetic: bool, rasterizer: str) -> Estimate:
    """Expected seconds of a scene's main job.

    Args:
        config: the scene's whole configuration.
        synthetic: whether its recording is made first. The length of a real one is not known beforehand.
        rasterizer: what renders: the kernels' variant, or anything else, of which no figure is known.
    """
    film, frames, splats = config["synthetic"], config["frames"], config["splats"]
    recorded = film["seconds"] * film["fps"]
    pictures = recorded / frames["stride"]
    area = (frames["resolution"] / 512) ** 2
    iteration = PIXELS_SHARE * area + (1 - PIXELS_SHARE) * splats["max_gaussians"] / 100_000
    known = rasterizer in ITERATION_S
    return Estimate(
        SYNTHETIC_START_S + SYNTHETIC_PICTURE_S * recorded * (film["size"] / 704) ** 2 if synthetic else 0.0,
        READING_START_S + READING_PICTURE_S * pictures * area if synthetic else None,
        _segments(config, pictures) if synthetic else None,
        _transient(config, ITERATION_S[rasterizer] / ITERATION_S["avx512"]) if known else None,
        splats["iterations"] * ITERATION_S[rasterizer] * iteration if known else None,
        ASKING_START_S + ASKING_PICTURE_S * pictures * area if synthetic and known else None,
    )


def _segments(config: Config, pictures: float) -> float | None:
    """Of the small SAM2 alone."""
    keys = config["segments"]
    if keys["segmenter"] != "sam2" or config["models"]["sam2_config"] != SMALL:
        return None
    side = keys["image_size"] or sam2_side(SMALL)
    return SEGMENTS_PICTURE_S * pictures * (side / SEGMENTS_SIDE) ** 2


def _transient(config: Config, slower: float) -> float:
    keys = config["transient"]
    if config["splats"]["masking"] == "none":
        return 0.0
    share = 1 + (keys["input_size"] / 96) ** 2 + keys["max_gaussians"] / 60_000
    return keys["iterations"] * TRANSIENT_ITERATION_S * slower * share / 3


def spoken(seconds: float) -> str:
    """``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
