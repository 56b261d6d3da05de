"""Alarms of the stages that train, transient, masks, splats and language, and of the scores."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.alarms.alarm import Alarm, exceeds

MAX_PROBABILITY = 0.2
"""Mean over all pixels of all frames. It is 0.05 to 0.1 in synthetic apartments and 0.02 to 0.11 in photographs in which
nothing moves; a recording on which the network failed had 0.47. The limit is the geometric mean of 0.1 and 0.47."""

MAX_MASKED_INSTANCES = 0.5
"""Share of the instances. What stands still is the larger part of any scene that a moving camera can reconstruct."""

MAX_MASKED_PIXELS = 0.25
"""Share of all pixels of all frames. In synthetic apartments with people it is 1 to 4 %, of the network alone 8 %
(from benchmarks/transient/README.md: precision, and the share of what is still that is masked)."""

MIN_PSNR_DB = 20.0
"""An error of a tenth of the range in every pixel. Synthetic apartments have 26 to 30 dB (benchmarks/ablation/README.md),
17 photographs of a desk 22.7 (benchmarks/tradeoff/README.md)."""

MAX_WITHOUT_CODE = 0.25
"""Share of the Gaussians. It is below 2 % with instances of every kind: a Gaussian is seen from many frames."""


def transient_alarms(mean_probability: float | None) -> Iterator[Alarm]:
    """Args: mean_probability: of being transient, over all pixels of all frames."""
    if exceeds(mean_probability, MAX_PROBABILITY):
        yield Alarm(
            "transient.probability",
            "0.02 to 0.11",
            f"a pixel is transient with a mean probability of {mean_probability:.2f}",
            "The network calls much of what stands still moving; look at transient.png, raise transient.transient_penalty or "
            "iterations, or set splats.masking: none where nothing moves",
        )


def masks_alarms(transient: int, instances: int, masked_pixels: float | None) -> Iterator[Alarm]:
    """Alarms of masks.

    Args:
        transient: masked instances; instances: of all.
        masked_pixels: share of all pixels of all frames.
    """
    if instances and exceeds(transient / instances, MAX_MASKED_INSTANCES):
        yield Alarm(
            "masks.instances",
            f"up to {MAX_MASKED_INSTANCES:.0%}",
            f"{transient} of {instances} instances are masked as moving",
            _LESS,
        )
    if exceeds(masked_pixels, MAX_MASKED_PIXELS):
        yield Alarm(
            "masks.pixels",
            f"up to {MAX_MASKED_PIXELS:.0%}",
            f"{masked_pixels:.1%} of all pixels are masked as moving, and not trained on",
            _LESS,
        )


def splats_alarms(psnr: NDArray[np.float64]) -> Iterator[Alarm]:
    """Args: psnr: (F,) of the held-out frames [dB]; none where nothing is held out."""
    mean = float(psnr.mean()) if len(psnr) else math.inf
    if not mean >= MIN_PSNR_DB:  # also what is no number
        yield Alarm(
            "splats.psnr",
            f"{MIN_PSNR_DB:g} dB or more",
            f"held-out frames are rendered with {mean:.2f} dB",
            "Look at splats.png: raise splats.iterations and max_gaussians, and check the poses",
        )


def language_alarms(without_code: float | None) -> Iterator[Alarm]:
    """Args: without_code: share of the Gaussians that mean nothing at any level."""
    if exceeds(without_code, MAX_WITHOUT_CODE):
        yield Alarm(
            "language.without_code",
            f"up to {MAX_WITHOUT_CODE:.0%}",
            f"{without_code:.1%} of the Gaussians have no code at any level",
            "Nothing there can be asked for; look at segments.png for pixels without an instance",
        )


def metrics_alarms(lowest: float | None, chance: float) -> Iterator[Alarm]:
    """Alarms of the accuracy of all queries.

    Args:
        lowest: lower bound of its interval; None where there is none.
        chance: accuracy of the best answer that does not look.
    """
    if lowest is not None and lowest <= chance:
        yield Alarm(
            "metrics.chance",
            "above chance",
            f"the accuracy may be {lowest:.1%}, and what does not look at the scene reaches {chance:.1%}",
            "These answers tell nothing: look at queries.png, and at the other alarms",
        )


_LESS = "Look at transient.png; raise masks.threshold, or set splats.masking: none where nothing moves"
