"""Alarms of the stages transient, masks, splats, language and metrics."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.alarms.alarm import Alarm, exceeds

# It is 0.05 to 0.1 in synthetic apartments, 0.02 to 0.11 in photographs of static scenes, and 0.47 in a
# recording on which the network failed. The limit is the geometric mean of 0.1 and 0.47.
# Mean probability of being transient, over all pixels of all frames.
MAX_PROBABILITY = 0.2

# Most of a scene must be static for a reconstruction from a moving camera.
# Share of the instances that are masked.
MAX_MASKED_INSTANCES = 0.5

# In synthetic apartments with people it is 1 to 4 %, and 8 % for the network's masks without refinement
# (derived from precision and the masked share of static pixels in benchmarks/transient/README.md).
# Share of all pixels of all frames that are masked.
MAX_MASKED_PIXELS = 0.25

# 20 dB is an error of a tenth of the range in every pixel. Synthetic apartments have 26 to 30 dB (benchmarks/ablation/README.md), 17 photographs of a desk 22.7
# (benchmarks/tradeoff/README.md).
# Mean PSNR of the held-out frames [dB].
MIN_PSNR_DB = 20.0

# It is below 2 %: a Gaussian is seen in many frames, and in some of them has an instance.
# Share of the Gaussians without a code at any level.
MAX_WITHOUT_CODE = 0.25


# Drift of 20 mm and 0.5 degrees (RMS) is corrected by at most 13 mm and 0.6 degrees, a fifth of the limit, in an apartment 1.1 m deep
# (benchmarks/corrections/README.md). Beyond it, gradient descent may end at any place that looks alike.
# Correction of a pose as an angle [rad]: of the rotation, or of the translation at the scene's median depth.
MAX_CORRECTION = 0.05

# Auto-exposure over 4 stops changes sRGB values by a factor of about 2.
# Gain of a color, or its inverse.
MAX_GAIN = 2.5


def transient_alarms(mean_probability: float | None) -> Iterator[Alarm]:
    """Alarms of the transient artifact; ``mean_probability`` is that of being transient, over all pixels of all frames."""
    if exceeds(mean_probability, MAX_PROBABILITY):
        yield Alarm(
            "transient.probability",
            "0.02 to 0.11",
            f"the mean probability of a transient pixel is {mean_probability:.2f}",
            "The network classifies static pixels as transient. Check transient.png; raise transient.transient_penalty or "
            "iterations, or set splats.masking to none if nothing moves",
        )


def masks_alarms(
    transient: int, instances: int, masked_pixels: float | None, withheld: str | None = None
) -> Iterator[Alarm]:
    """Alarms of the masks artifact.

    Args:
        masked_pixels: share of all pixels of all frames.
        withheld: why nothing is masked, in words; None if it need not be told.
    """
    if withheld is not None:
        yield Alarm(
            "masks.withheld",
            "up to masks.max_share",
            f"nothing is masked, because {withheld}",
            "Check transient.png: blurred frames, wrong poses and changing exposure look like motion. Set splats.masking "
            "to none if nothing moves",
        )
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
            f"{masked_pixels:.1%} of all pixels are masked and excluded from training",
            _LESS,
        )


def splats_alarms(psnr: NDArray[np.float64]) -> Iterator[Alarm]:
    """Alarms of the splats artifact; ``psnr``: (F,) of the held-out frames [dB], empty if there are none."""
    mean = float(psnr.mean()) if len(psnr) else math.inf
    if not mean >= MIN_PSNR_DB:  # true for NaN, too
        yield Alarm(
            "splats.psnr",
            f"{MIN_PSNR_DB:g} dB or more",
            f"the mean PSNR of held-out frames is {mean:.2f} dB",
            "Check splats.png and the poses; raise splats.iterations and max_gaussians",
        )


def corrections_alarms(
    shift: NDArray[np.float64], turn: NDArray[np.float64], gain: NDArray[np.float64], depth: float
) -> Iterator[Alarm]:
    """Alarms of the corrections of F frames.

    Args:
        shift: (F,) distance [m]; turn: (F,) angle [deg]; gain: (F, 3).
        depth: median depth of the scene [m].
    """
    angle = np.maximum(shift / depth, np.radians(turn))
    if wrong := int((angle > MAX_CORRECTION).sum()):
        most = int(angle.argmax())
        yield Alarm(
            "splats.pose_correction",
            f"up to {100 * MAX_CORRECTION:g} % of the scene's depth of {depth:.3g} m, and {np.degrees(MAX_CORRECTION):.1f} degrees",
            f"training moved the poses of {wrong} of {len(angle)} frames farther, of frame {most} by {1e3 * shift[most]:.0f} mm "
            f"and {turn[most]:.1f} degrees",
            "Check splats.png and the poses, or set camera.refine_poses to off",
        )
    factor = np.exp(np.abs(np.log(np.maximum(gain, 1e-9)))).max(axis=1, initial=1.0)
    if wrong := int((factor > MAX_GAIN).sum()):
        most = int(factor.argmax())
        yield Alarm(
            "splats.gain",
            f"{1 / MAX_GAIN:g} to {MAX_GAIN:g}",
            f"the gains of {wrong} of {len(factor)} frames are outside, of frame {most} {_gains(gain[most])}",
            "Those frames are nearly black or white. Check them in frames.zarr, or set camera.compensate_exposure to off",
        )


def _gains(gain: NDArray[np.float64]) -> str:
    return ", ".join(f"{one:.2f}" for one in gain)


def language_alarms(without_code: float | None) -> Iterator[Alarm]:
    """Alarms of the language artifact; ``without_code``: share of the Gaussians without a code at any level."""
    if exceeds(without_code, MAX_WITHOUT_CODE):
        yield Alarm(
            "language.without_code",
            f"up to {MAX_WITHOUT_CODE:.0%}",
            f"{without_code:.1%} of the Gaussians have no code at any level",
            "Queries find nothing there. Check instances.png for pixels without an instance",
        )


def metrics_alarms(lowest: float | None, chance: float) -> Iterator[Alarm]:
    """Alarms of the localization accuracy over all queries.

    Args:
        lowest: lower bound of its interval; None without an interval.
        chance: accuracy of the best answer that ignores the scene.
    """
    if lowest is not None and lowest <= chance:
        yield Alarm(
            "metrics.chance",
            "above chance",
            f"the accuracy may be as low as {lowest:.1%}; an answer that ignores the scene reaches {chance:.1%}",
            "The answers may be chance. Check queries.png and the other alarms",
        )


_LESS = "Check transient.png; raise masks.threshold, or set splats.masking to none if nothing moves"
