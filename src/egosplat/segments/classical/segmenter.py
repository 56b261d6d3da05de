"""The segmenter without weights: graph segmentation, region merging, and optical flow.

It knows nothing of objects: the baseline for segmenters that have learned, and a choice for pictures unlike
everything that they have learned from.
"""

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.classical.following import follow
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.classical.tracking import propagate, track, track_levels
from egosplat.segments.options import LEVELS

__all__ = ["LEVELS", "ClassicalOptions", "follow", "propagate", "segment", "track", "track_levels"]


def segment(
    picture: NDArray[np.uint8], valid: NDArray[np.bool_], options: ClassicalOptions
) -> NDArray[np.int32]:
    """Cut a picture into nested regions.

    Args:
        picture: (H, W, 3) uint8 RGB.
        valid: (H, W) bool; pixels outside have no influence.
        options: see ``ClassicalOptions``.

    Returns:
        (3, H, W) int32 regions of the levels subpart, part and whole, numbered from 0 at each level, -1 outside
        of ``valid``. A region is a union of regions of the level before.

    Raises:
        ValueError: wrong shape or element type.
    """
    return partition(picture, valid, options)[1:]
