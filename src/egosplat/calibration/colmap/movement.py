"""Whether the camera moves at all, from a few frames, before COLMAP spends minutes on what it cannot solve.

What moves before a tripod COLMAP takes for a scene. A share of the features that stay in every pair of frames tells it: 8 % and more
in three videos of a fixed camera, none in photographs of a moving one and in a video from an unsteady hand.
"""

import itertools
import math

import cv2
import numpy as np

from egosplat.arrays import Array
from egosplat.calibration.colmap.database import Project
from egosplat.errors import UserError
from egosplat.images import evenly_spaced
from egosplat.progress import track

# Frames spread over the recording, both ends included, all pairs of them, and their longer side [px].
_FRAMES, _SIDE = 8, 640
_FEATURES, _RATIO = 1000, 0.75
# A feature that stays moves by less than this share of the diagonal: 1.5 px in pictures of 640 x 360.
_STAYS = 0.002
# Fewer matches tell nothing about a pair.
_MIN_MATCHES = 20
# Letters on a display, dirt on the lens or the brim of a cap stay too: fewer features, or a smaller part of the picture.
_MIN_SHARE, _MIN_AREA = 0.05, 0.1
# One picture with somebody before the camera hides nothing; a camera that moves in the last eighth moves in 7 of 28 pairs.
_STILL_PAIRS = 0.9

# Positions (N, 2) as shares of the diagonal, and descriptors (N, 128).
_Features = tuple[Array, cv2.typing.MatLike]


def check_camera_moves(project: Project) -> None:
    """Compare images spread over a recording, in seconds; UserError if the camera stands still."""
    names = project.names
    spread = [names[index] for index in evenly_spaced(len(names), _FRAMES)]
    chosen = track(spread, "COLMAP: does the camera move", unit="frame")
    pairs = [*itertools.combinations([_features(project, name) for name in chosen], 2)]
    shares = [share for pair in pairs if (share := _share_that_stays(*pair)) is not None]
    still = sum(share >= _MIN_SHARE for share in shares)
    if not shares or len(shares) < len(pairs) / 2 or still < _STILL_PAIRS * len(shares):
        return
    raise UserError(
        f"the camera stands still: {np.median(shares):.0%} of the features stay in place in {still} of {len(shares)} "
        "pairs of frames spread over the recording. A fixed camera shows no depth, and what moves before it is no "
        "scene: masks do not help\n"
        "Record with a camera that moves, or take the part in which it does (frames.start_s, frames.end_s)"
    )


def _features(project: Project, name: str) -> _Features:
    """SIFT features of an image, reduced to ``_SIDE``."""
    image = cv2.imread(str(project.images / name), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    scale = min(1.0, _SIDE / max(image.shape))
    size = [max(1, round(scale * side)) for side in image.shape[::-1]]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if (path := project.mask_of(name)).exists() else None
    inside = None if mask is None else cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT.create(_FEATURES).detectAndCompute(small, inside)
    positions = np.array([point.pt for point in points], np.float64).reshape(-1, 2) / math.hypot(*size)
    return positions, np.empty((0, 128)) if descriptors is None else descriptors


def _share_that_stays(first: _Features, second: _Features) -> float | None:
    """Share of the features that are at the same place in both, 0 in a small part of the picture; None if too few match."""
    fewest = min(len(first[0]), len(second[0]))
    if fewest < _MIN_MATCHES:
        return None
    nearest = cv2.BFMatcher().knnMatch(first[1], second[1], k=2)
    matches = [best for best, other in nearest if best.distance < _RATIO * other.distance]
    if len(matches) < _MIN_MATCHES:
        return None
    start = first[0][[match.queryIdx for match in matches]]
    end = second[0][[match.trainIdx for match in matches]]
    staying = start[np.linalg.norm(end - start, axis=1) < _STAYS]
    if len(staying) < 3:
        return 0.0
    # Twice the area of the convex hull: 1 for a whole square picture.
    area = 2.0 * cv2.contourArea(cv2.convexHull(staying.astype(np.float32)))
    return len(staying) / fewest if area >= _MIN_AREA else 0.0
