"""Where the tracks of what moves are in each frame: lifted onto the surface that the Gaussians show."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array, Camera, transform
from egosplat.histories.places import Recording
from egosplat.progress import track

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# Pixels this near to the border of what the camera shows belong to its edge, as a share of the longer side.
_EDGE = 0.01
# Masks are compared at this size [px].
_COMPARED = 128

# Type of each column of sightings, and shape of a row.
_COLUMNS = {
    **dict.fromkeys(("frame", "track", "area"), (np.int64, ())),
    "edge": (np.float64, ()),
    **dict.fromkeys(("center", "local"), (np.float64, (3,))),
    "size": (np.float64, ()),
    "box": (np.int32, (4,)),
}


@dataclass(frozen=True, eq=False)
class Sightings:
    """S masks of tracks, by frame and track.

    Attributes:
        frame, track: (S,) int64.
        area: (S,) int64 pixels.
        edge: (S,) float64 share of the pixels at the edge of what the camera shows.
        center: (S, 3) float64 the mask's middle, at the median depth of its pixels, in the world [m].
        local: (S, 3) float64 the same point in the camera's axes [m].
        size: (S,) float64 side of a square as large as the mask, at that depth [m].
        box: (S, 4) int32 x0, y0, x1, y1 around the mask, the ends exclusive [px].
        inside: share of the smaller of two masks of a frame that the other covers, by (frame, smaller track, larger track).
    """

    frame: Ints
    track: Ints
    area: Ints
    edge: Array
    center: Array
    local: Array
    size: Array
    box: NDArray[np.int32]
    inside: dict[tuple[int, int, int], float]

    @property
    def depth(self) -> Array:
        """(S,) depth along the camera's axis [m]."""
        return self.local[:, 2]

    def take(self, chosen: NDArray) -> "Sightings":
        """Select sightings; ``inside`` stays whole."""
        return Sightings(**{name: getattr(self, name)[chosen] for name in _COLUMNS}, inside=self.inside)


def see_tracks(frames: Ints, is_track: Bools, recording: Recording) -> Sightings:
    """Find each track in the frames that show it.

    Args:
        frames: frames with a pose.
        is_track: (N,) bool, the instances that are tracks.
        recording: its depth is asked for in frames with a track.
    """
    valid, camera = recording.valid, recording.camera
    radius = max(1, round(_EDGE * max(valid.shape)))
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    edge = valid & (cv2.erode(valid.astype(np.uint8), kernel, borderValue=0) == 0)
    rows, inside = [], {}
    for frame in track(frames.tolist(), "looking at what moves", unit="frame"):
        found = recording.labels(frame)
        numbers = np.unique(found[found >= 0])
        numbers = numbers[is_track[numbers]]
        if not len(numbers):
            continue
        masks, surface = [(found == one).any(axis=0) for one in numbers], recording.depth(frame)
        for one, mask in zip(numbers.tolist(), masks, strict=True):
            seen = _see(mask, surface, edge, camera, recording.camera_to_world[frame])
            if seen is not None:
                rows.append((frame, one, *seen))
        inside |= _nested(frame, numbers, masks)
    columns = zip(*rows, strict=True) if rows else [()] * len(_COLUMNS)
    kinds = zip(_COLUMNS.items(), columns, strict=True)
    arrays = {name: np.array(values, kind).reshape(-1, *shape) for (name, (kind, shape)), values in kinds}
    return Sightings(**arrays, inside=inside)


def _see(mask: Bools, surface: Array, edge: Bools, camera: Camera, pose: Array) -> tuple | None:
    """Area, share at the edge, center, local, size and box of a mask; None without depth."""
    row, column = np.nonzero(mask)
    scale = np.array(surface.shape) / mask.shape
    z = surface[(row * scale[0]).astype(int), (column * scale[1]).astype(int)]
    z = z[np.isfinite(z) & (z > 0)]
    if not len(z):
        return None
    depth = float(np.median(z))
    x, y = column.mean() + 0.5, row.mean() + 0.5
    local = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]) * depth
    size = np.sqrt(len(row) / (camera.fx * camera.fy)) * depth
    box = (column.min(), row.min(), column.max() + 1, row.max() + 1)
    return len(row), edge[row, column].mean(), transform(pose, local), local, size, box


def _nested(frame: int, numbers: NDArray[np.int32], masks: list[Bools]) -> dict[tuple[int, int, int], float]:
    """What share of each smaller mask lies in a larger one."""
    step = max(1, max(masks[0].shape) // _COMPARED)
    flat = np.stack([mask[::step, ::step].ravel() for mask in masks]).astype(np.float32)
    common, area = flat @ flat.T, flat.sum(axis=1)
    found = {}
    for small, large in np.argwhere(common > 0).tolist():
        if small != large and (area[small], small) < (area[large], large):
            pair = frame, int(numbers[small]), int(numbers[large])
            found[pair] = float(common[small, large] / area[small])
    return found
