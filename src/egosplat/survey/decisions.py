"""Decide from the measurements of a survey whether anything moves, and what the camera requires."""

import math
from typing import Any

import numpy as np

from egosplat.arrays import Array
from egosplat.survey.brightness import exposure_curve
from egosplat.survey.motion import Motion

# Shares of the voting pixels below which nothing moves: still recordings have 0 that keeps moving, and flow errs up to 0.15 %.
_LEAST_SHARE, _LEAST_FLEETING = 5e-4, 2e-3
# Hands at work are seen to move in passing: a quarter of ``min_share`` of such movement is much (benchmarks/survey).
_OF_FLEETING = 1 / 4
# Poses are refined if what a correction explains is so many times the noise that it leaves. Revisits see a place from
# further apart: flow between them errs more, and fewer than two do not tell.
_LIMIT, _REVISIT_LIMIT, _MIN_REVISITS = 0.7, 1.0, 2
# Exposure is compensated if it changes by more than a third of a stop, the smallest step of a camera's dial.
_MAX_STOPS = 1 / 3


def decide_motion(motion: Motion, min_share: float) -> dict[str, Any]:
    """The section ``motion`` of survey.json. What cannot be told counts as moving, and is masked."""
    share, fleeting = map(finite, motion.shares or (None, None))
    limits = min_share, _OF_FLEETING * min_share
    masked = share is None or fleeting is None or share >= limits[0] or fleeting >= limits[1]
    columns = ("moving", "lasting", "voting", "noise_px", "stops")
    return {
        "verdict": _tell(share, fleeting, limits, masked),
        "masking": "refined" if masked else "none",
        "share": share,
        "min_share": min_share,
        "fleeting": fleeting,
        "voting": finite(motion.voting.mean()) if len(motion.pairs) else None,
        "noise_px": finite(median(motion.noise_px)),
        "pairs": [
            {"frames": pair} | {name: finite(getattr(motion, name)[row]) for name in columns}
            for row, pair in enumerate(motion.pairs.tolist())
        ],
    }


def _tell(share: float | None, fleeting: float | None, limits: tuple[float, float], masked: bool) -> str:
    """What moves, in words."""
    so = f"so {'moving objects are' if masked else 'nothing is'} masked"
    if share is None or fleeting is None:
        return f"too little can be compared to know what moves, {so}"
    keeps, passes = f"{100 * share:.2f} %", f"{100 * fleeting:.2f} %"
    if not masked and share < _LEAST_SHARE and fleeting <= _LEAST_FLEETING:
        return f"nothing in view keeps moving, {passes} of the picture flickers, {so}"
    limit = " and ".join(f"{100 * one:.3g} %" for one in limits)
    return f"{keeps} of the picture keeps moving, {passes} moves for a short time (limits: {limit}), {so}"


def decide_camera(motion: Motion) -> dict[str, Any]:
    """The section ``camera`` of survey.json. What is not measured asks for no correction."""
    count = len(motion.pairs)
    parts = (
        _pose_residual(motion.before_px[:count], motion.after_px[:count], 1, _LIMIT),
        _pose_residual(motion.before_px[count:], motion.after_px[count:], _MIN_REVISITS, _REVISIT_LIMIT),
    )
    # Consecutive frames or revisits, whichever stand out more.
    excess, explained, noise = max(parts, key=lambda found: found[0])
    curve = exposure_curve(motion.pairs, motion.stops)
    stops = float(np.ptp(np.quantile(list(curve.values()), [0.05, 0.95]))) if curve else None
    return {
        "pose_residual_px": finite(explained),
        "pose_noise_px": finite(noise),
        "revisits": len(motion.after_px) - count,
        "refine_poses": excess > 1,
        "brightness_stops": finite(stops),
        "compensate_exposure": stops is not None and stops > _MAX_STOPS,
    }


def _pose_residual(before_px: Array, after_px: Array, least: int, limit: float) -> tuple[float, float, float]:
    """How far the flow that corrections explain stands out of the noise they leave, and both [px]; NaN of few pairs."""
    known = np.isfinite(before_px) & np.isfinite(after_px)
    if known.sum() < least:
        return -math.inf, math.nan, math.nan
    before, after = before_px[known], after_px[known]
    # Medians, because a single pair can have too little in common for a correction.
    noise = float(np.median(after))
    explained = float(np.median(np.sqrt(np.maximum(before**2 - after**2, 0.0)) / after)) * noise
    return explained / noise / limit, explained, noise


def median(values: Array) -> float | None:
    """Median of the finite ones of some values; None without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def finite(value: float | None, digits: int = 6) -> float | None:
    """A number for a document: None if it is unknown. Rounded, because its last bits depend on the processor."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
