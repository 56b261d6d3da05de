"""Does anything move in a recording? The share of its pictures that breaks the known poses."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array, Camera
from egosplat.progress import track
from egosplat.survey.depth import depth_quantile, seen_depths
from egosplat.survey.motion import Bools, Grey, find_moving

SIDE = 256
"""Longest side of the pictures that flow is found of [px]."""
LEAST_MEASURED = 0.2
"""Of the pictures' valid pixels, flow must be believed in so many, or nothing can be said."""
FEWEST_PAIRS = 2
_APART_S, _TOO_FAR_S = 0.2, 1.1
"""Frames of a pair are so far apart in time, or the next more; at most so far."""
_MOST_PAIRS = 120
_NEAREST, _NEARER = 0.02, 0.5
"""The least depth of a static point: that of the nearest points of the scene, by this share, and a part of it."""
_LEAST_DEPTH_M = 0.2
"""The same where no points are known: an arm's length is 0.6 m."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What P pairs of frames show.

    Attributes:
        pairs: (P, 2) int64 frames.
        moving: (P,) share of the measured pixels that moves; 0 where none is measured.
        measured: (P,) share of the valid pixels in which flow is believed.
    """

    pairs: NDArray[np.int64]
    moving: Array
    measured: Array

    @property
    def share(self) -> float | None:
        """The mean of ``moving``; None where too little is measured to say."""
        enough = len(self.pairs) >= FEWEST_PAIRS and self.measured.mean() >= LEAST_MEASURED
        return float(self.moving.mean()) if enough else None


def is_static(motion: Motion, threshold: float) -> bool:
    """Whether less than a share of the pictures moves; not where too little is measured to say."""
    return motion.share is not None and motion.share < threshold


def choose_pairs(times_ns: NDArray[np.int64], registered: Bools) -> NDArray[np.int64]:
    """(P, 2) frames with a pose a short while apart, evenly among all such pairs.

    Args:
        times_ns: (F,) increasing.
        registered: (F,) bool.
    """
    known = np.flatnonzero(registered)
    # Half a millisecond less: a camera's clock is not exact.
    later = np.searchsorted(times_ns[known], times_ns[known] + round((_APART_S - 5e-4) * 1e9))
    first = np.flatnonzero(later < len(known))
    pairs = np.stack([known[first], known[later[first]]], axis=1)
    pairs = pairs[np.diff(times_ns[pairs], axis=1)[:, 0] <= _TOO_FAR_S * 1e9]
    count = len(pairs)
    if count <= _MOST_PAIRS:
        return pairs
    return pairs[[count * (2 * part + 1) // (2 * _MOST_PAIRS) for part in range(_MOST_PAIRS)]]


def measure_motion(frames: Artifact, poses: Artifact) -> Motion:
    """Look at pairs of frames all through a recording, a picture at a time."""
    pairs = choose_pairs(frames.read("timestamp_ns"), poses.read("registered"))
    camera_to_world, points = poses.read("camera_to_world"), poses.read("points/xyz")
    valid, camera = _working(frames, poses)
    size = valid.shape[::-1]
    moving, measured = np.zeros(len(pairs)), np.zeros(len(pairs))
    inside = max(1, int(valid.sum()))
    for row, (first, second) in enumerate(track(pairs, "looking for motion", unit="pair")):
        walk = camera_to_world[first], camera_to_world[second]
        pictures = [_grey(frames.row("rgb", frame), size) for frame in (first, second)]
        found = find_moving(*pictures, valid, camera.matrix, walk, _least_depth(camera, walk[0], points))
        count = int(found.measured.sum())
        moving[row], measured[row] = found.moving.sum() / max(1, count), count / inside
    return Motion(pairs, moving, measured)


def _working(frames: Artifact, poses: Artifact) -> tuple[Bools, Camera]:
    """The valid pixels and the camera of the pictures at the working size."""
    _, height, width, _ = frames.shape("rgb")
    scale = min(1.0, SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height).scaled_to(*size)
    valid = cv2.resize(frames.read("valid").astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return valid > 1 - 1e-6, camera


def _grey(rgb: NDArray[np.uint8], size: tuple[int, int]) -> Grey:
    return cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)


def _least_depth(camera: Camera, camera_to_world: Array, points: Array) -> float:
    nearest = depth_quantile(seen_depths(camera, camera_to_world, points), _NEAREST)
    return _LEAST_DEPTH_M if nearest is None else _NEARER * nearest
