"""Which pixels show what is asked for (docs/method.md#segmentation-threshold)."""

from dataclasses import dataclass

import numpy as np

from egosplat.query.smoothing import Map, Mask, majority


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A mask.

    Attributes:
        level: index of the level that it was made at, the first of equal ones.
        mask: (H, W) bool.
    """

    level: int
    mask: Mask


def segment(
    raw: Map, filtered: Map, seen: Mask, segmentation_threshold: float, majority_px: int
) -> Segmentation | None:
    """The mask of the level at which the mean of raw and smoothed relevancy is largest.

    This mean is brought to 0..1 over what is seen at the level; what is above the threshold belongs to the mask, which
    then takes the majority of its surroundings. LangSplat's ``clip(2 g - 1, 0, 1) > 0.4`` is ``g > 0.7``. A relative
    threshold finds something for every query, present or not; only a constant map has an empty mask.

    Args:
        raw: (L, H, W) float32 relevancy, finite.
        filtered: the same, smoothed.
        seen: (L, H, W) bool; other pixels do not count and are in no mask.
        segmentation_threshold: see ``QueryOptions``.
        majority_px: see ``majority``.

    Returns:
        None where nothing is seen at any level.
    """
    if not seen.any():
        return None
    combined = (raw + filtered) / 2
    peaks = combined.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    values, top = combined[level], peaks[level]
    lowest = values.min(where=seen[level], initial=np.inf)
    above = (values - lowest > segmentation_threshold * (top - lowest)) & seen[level]
    return Segmentation(level, majority(above, majority_px) & seen[level])
