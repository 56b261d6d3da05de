"""Where the tracks of what moves are in each frame: lifted onto the surface that the Gaussians show."""

from typing import Any

import cv2
import numpy as np

from egosplat.arrays import Array, Bools, Ints, Ints32
from egosplat.geometry import Camera, transform
from egosplat.histories.places import Recording
from egosplat.progress import track

# Pixels this near to the border of what the camera shows belong to its edge, as a share of the longer side.
_EDGE = 0.01
# Masks are compared at this size [px].
_COMPARED = 128

# A mask of a track in a frame.
SIGHTING = np.dtype(
    [
        ("frame", np.int64),
        ("track", np.int64),
        # Pixels, and the share of them at the edge of what the camera shows.
        ("area", np.int64),
        ("edge", np.float64),
        # The mask's middle, at the median depth of its pixels, in the world and in the camera's axes [m].
        ("center", np.float64, (3,)),
        ("local", np.float64, (3,)),
        # Side of a square as large as the mask, at that depth [m].
        ("side", np.float64),
        # x0, y0, x1, y1 around the mask, the ends exclusive [px].
        ("box", np.int32, (4,)),
    ]
)

# (S,) ``SIGHTING``, an np.recarray: columns are attributes.
Sightings = Any

# Share of the smaller of two masks of a frame that the other covers, by (frame, smaller track, larger track).
Nesting = dict[tuple[int, int, int], float]


def see_tracks(frames: Ints, recording: Recording) -> tuple[Sightings, Nesting]:
    """Find each track in the frames that show it, among ``frames`` with a pose: (S,) ``SIGHTING``, by frame and track."""
    valid, rows, inside = recording.valid, [], {}
    radius = max(1, round(_EDGE * max(valid.shape)))
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    edge = valid & (cv2.erode(valid.astype(np.uint8), kernel, borderValue=0) == 0)
    for frame in track(frames.tolist(), "looking at what moves", unit="frame"):
        labels = recording.instances.row("labels", frame)
        numbers = np.unique(labels[labels >= 0])
        numbers = numbers[recording.is_track[numbers]]
        if not len(numbers):
            continue
        masks, surface = [(labels == number).any(axis=0) for number in numbers], recording.depth(frame)
        for number, mask in zip(numbers.tolist(), masks, strict=True):
            seen = _see(mask, surface, edge, recording.camera, recording.camera_to_world[frame])
            if seen is not None:
                rows.append((frame, number, *seen))
        inside |= _nested(frame, numbers, masks)
    return np.array(rows, SIGHTING).view(np.recarray), inside


def _see(mask: Bools, surface: Array, edge: Bools, camera: Camera, pose: Array) -> tuple | None:
    """Area, share at the edge, center, local, side and box of a mask; None without depth."""
    row, column = np.nonzero(mask)
    scale = np.array(surface.shape) / mask.shape
    z = surface[(row * scale[0]).astype(int), (column * scale[1]).astype(int)]
    z = z[np.isfinite(z) & (z > 0)]
    if not len(z):
        return None
    depth = float(np.median(z))
    x, y = column.mean() + 0.5, row.mean() + 0.5
    local = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]) * depth
    side = np.sqrt(len(row) / (camera.fx * camera.fy)) * depth
    box = (column.min(), row.min(), column.max() + 1, row.max() + 1)
    return len(row), edge[row, column].mean(), transform(pose, local), local, side, box


def _nested(frame: int, numbers: Ints32, masks: list[Bools]) -> Nesting:
    step = max(1, max(masks[0].shape) // _COMPARED)
    flat = np.stack([mask[::step, ::step].ravel() for mask in masks]).astype(np.float32)
    common, area = flat @ flat.T, flat.sum(axis=1)
    found = {}
    for small, large in np.argwhere(common > 0).tolist():
        if (area[small], small) < (area[large], large):
            pair = frame, int(numbers[small]), int(numbers[large])
            found[pair] = float(common[small, large] / area[small])
    return found
