"""Whether the camera moves at all, from a few frames, before COLMAP spends minutes on what it cannot solve.

A camera on a tripod sees features stay where they are however far apart in time two frames lie; hands and people move
in front of it, and COLMAP takes them for a scene. A share of the features that stay in every pair of frames tells it: 8 %
and more in three videos of a fixed camera, none in photographs of a moving one and in a video from an unsteady hand.
"""

import itertools
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.progress import track

# Frames spread over the recording, both ends included, all pairs of them, and their longer side [px].
_FRAMES, _SIDE = 8, 640
_FEATURES, _RATIO = 1000, 0.75
# A feature that stays moves by less than this share of the diagonal: 1.5 px in pictures of 640 x 360.
STAYS = 0.002
# Fewer matches tell nothing about a pair.
_MIN_MATCHES = 20
# Letters on a display, dirt on the lens or the brim of a cap stay too. They have fewer of the features, or a smaller
# part of the picture.
_MIN_SHARE, _MIN_AREA = 0.05, 0.1
# One picture in which somebody stands before the camera shall not hide that it is fixed; a camera that moves in the last
# eighth of the recording moves in 7 of 28 pairs.
_STILL_PAIRS = 0.9

# Positions (N, 2) as shares of the diagonal, and descriptors (N, 128).
_Features = tuple[NDArray[np.float64], NDArray[np.float32]]


def check_camera_moves(
    folder: Path, names: list[str], mask_of: Callable[[str], NDArray[np.uint8] | None]
) -> None:
    """Compare images spread over a recording, in seconds; UserError if the camera stands still."""
    spread = np.linspace(0, len(names) - 1, min(_FRAMES, len(names))).round().astype(int)
    chosen = track([names[index] for index in spread], "COLMAP: does the camera move", unit="frame")
    found = [
        _features(cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE), mask_of(name)) for name in chosen
    ]
    shares = [share_that_stays(*pair) for pair in itertools.combinations(found, 2)]
    told = [share for share in shares if share is not None]
    still = [share for share in told if share >= _MIN_SHARE]
    if not told or len(told) < len(shares) / 2 or len(still) < _STILL_PAIRS * len(told):
        return
    raise UserError(
        f"the camera stands still: {np.median(told):.0%} of the features stay in place in {len(still)} of {len(told)} "
        "pairs of frames spread over the recording. A fixed camera shows no depth, and what moves before it is no "
        "scene: masks do not help\n"
        "Record with a camera that moves, or take the part in which it does (frames.start_s, frames.end_s)"
    )


def share_that_stays(first: _Features, second: _Features) -> float | None:
    """Share of the features of two frames that are at the same place in both; None if too few match to tell.

    Features in a small part of the picture count as none.
    """
    if min(len(first[0]), len(second[0])) < _MIN_MATCHES:
        return None
    nearest = cv2.BFMatcher().knnMatch(first[1], second[1], k=2)
    matches = [one for one, other in nearest if one.distance < _RATIO * other.distance]
    if len(matches) < _MIN_MATCHES:
        return None
    start = first[0][[match.queryIdx for match in matches]]
    end = second[0][[match.trainIdx for match in matches]]
    staying = start[np.linalg.norm(end - start, axis=1) < STAYS]
    return len(staying) / min(len(first[0]), len(second[0])) if _area(staying) >= _MIN_AREA else 0.0


def _area(positions: NDArray[np.float64]) -> float:
    """Area of the convex hull of positions, where a whole square picture has 1."""
    if len(positions) < 3:
        return 0.0
    return 2.0 * cv2.contourArea(cv2.convexHull(positions.astype(np.float32)))


def _features(image: NDArray[np.uint8], mask: NDArray[np.uint8] | None) -> _Features:
    """SIFT features of a picture, reduced to ``_SIDE``."""
    scale = min(1.0, _SIDE / max(image.shape))
    size = [max(1, round(scale * side)) for side in image.shape[::-1]]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    inside = None if mask is None else cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT_create(_FEATURES).detectAndCompute(small, inside)
    positions = np.array([point.pt for point in points], np.float64).reshape(-1, 2) / np.hypot(*size)
    return positions, np.empty((0, 128), np.float32) if descriptors is None else descriptors
