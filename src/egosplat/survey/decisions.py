"""Decide from the measurements of a survey whether anything moves, and what the camera requires."""

import math
from dataclasses import dataclass

import numpy as np

from egosplat.geometry import Array
from egosplat.survey.brightness import exposure_curve
from egosplat.survey.motion import Motion

# Share of the voting pixels that keeps moving from which something moves: still recordings have 0, moving ones at least
# 1e-3 (benchmarks/survey).
_LEAST_SHARE = 5e-4
# A smaller share is none: in a long recording, less than one track of the smallest region.
_NO_SHARE = 1e-4
# More regions that move for fewer than three pairs may be things that pass fast. Errors of flow reach 0.15 %, where poses are off by 1.5 % of the
# depth too; the one moving recording without lasting regions has 0.24 %.
_MAX_FLEETING = 2e-3
# Poses are refined if what a correction explains is so many times the noise that it leaves. Revisits see a place from
# further apart: flow between them errs more.
_LIMIT, _REVISIT_LIMIT = 0.7, 1.0
# Fewer revisits do not tell.
_MIN_REVISITS = 2
# Exposure is compensated if it changes by more than a third of a stop, the smallest step of a camera's dial.
_MAX_STOPS = 1 / 3


@dataclass(frozen=True)
class PoseResidual:
    """Flow that a correction of the poses explains, the noise that it leaves, and the limit of their ratio [px]."""

    explained_px: float
    noise_px: float
    limit: float

    @property
    def excess(self) -> float:
        """How far the explained flow stands out of the noise; above 1, poses are refined."""
        return self.explained_px / self.noise_px / self.limit


def moving_share(share: float | None, fleeting: float | None) -> float | None:
    """Share of the picture that moves; None if it cannot be told. Arguments: ``Motion.share`` and ``Motion.fleeting``."""
    untold = share is None or fleeting is None or (share < _NO_SHARE and fleeting > _MAX_FLEETING)
    return None if untold else share


def is_static(share: float | None) -> bool:
    """Whether nothing moves. What cannot be told counts as moving."""
    return share is not None and share < _LEAST_SHARE


def needs_masks(share: float | None, min_share: float) -> bool:
    """Whether enough of the picture moves to be masked. What cannot be told is masked."""
    return share is None or share >= min_share


def pose_residual(motion: Motion) -> PoseResidual | None:
    """The residual of consecutive frames or of revisits, whichever stands out more; None if nothing is measured."""
    count = len(motion.pairs)
    near = _residual(motion.before_px[:count], motion.after_px[:count], 1, _LIMIT)
    again = _residual(motion.before_px[count:], motion.after_px[count:], _MIN_REVISITS, _REVISIT_LIMIT)
    known = [one for one in (near, again) if one is not None]
    return max(known, key=lambda one: one.excess) if known else None


def refines_poses(residual: PoseResidual | None) -> bool:
    """Whether the poses leave flow that stands out of its noise. What is not measured asks for nothing."""
    return residual is not None and residual.excess > 1


def brightness_range(motion: Motion) -> float | None:
    """Range of the exposure over the recording [stops]; None if unknown."""
    curve = exposure_curve(motion.pairs, motion.stops)
    # Of 90 % of the frames.
    return float(np.ptp(np.quantile(list(curve.values()), [0.05, 0.95]))) if curve else None


def compensates_exposure(stops: float | None) -> bool:
    """Whether the exposure changes by more than a third of a stop. What is not measured asks for nothing."""
    return stops is not None and stops > _MAX_STOPS


def _residual(before_px: Array, after_px: Array, least: int, limit: float) -> PoseResidual | None:
    known = np.isfinite(before_px) & np.isfinite(after_px)
    if known.sum() < least:
        return None
    before, after = before_px[known], after_px[known]
    # Medians, because a single pair can have too little in common for a correction.
    explained = np.median(np.sqrt(np.maximum(before**2 - after**2, 0.0)) / after)
    noise = float(np.median(after))
    return PoseResidual(float(explained) * noise, noise, limit)


def finite(value: float | None, digits: int = 6) -> float | None:
    """A number for a document: None if it is unknown. Rounded, because its last bits depend on the processor."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
