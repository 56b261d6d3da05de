"""Find the views of instances, cut their crops and encode them with OpenCLIP (docs/method.md#crops)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from egosplat.artifacts.checkpoint import lie_within
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import lies_on_its_side
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.progress import track

Pixels = NDArray[np.uint8]
Labels = NDArray[np.int32]
Ints = NDArray[np.int32]

# OpenCLIP's preprocessing uses PIL's resampling, which smooths when it shrinks an image; OpenCV's does not.
RESAMPLING = {"bicubic": Image.Resampling.BICUBIC, "bilinear": Image.Resampling.BILINEAR}


@dataclass(frozen=True)
class InstanceViews:
    """R views: instances that frames show.

    Attributes:
        table: (R, 7) int32, with the columns ``instance``, ``frame``, ``area`` [px], and ``box``: x0, y0, x1, y1 [px] with
            exclusive ends.
    """

    table: Ints

    def __len__(self) -> int:
        return len(self.table)

    @property
    def instance(self) -> Ints:
        """(R,)."""
        return self.table[:, 0]

    @property
    def frame(self) -> Ints:
        """(R,)."""
        return self.table[:, 1]

    @property
    def area(self) -> Ints:
        """(R,) [px]."""
        return self.table[:, 2]

    @property
    def box(self) -> Ints:
        """(R, 4) [px]."""
        return self.table[:, 3:]

    def chosen(self, which: NDArray | slice) -> "InstanceViews":
        """Select views by a mask or row indices."""
        return InstanceViews(self.table[which])

    @property
    def by_frame(self) -> NDArray[np.int64]:
        """(R,) row order by frame, then instance: the order of encoding."""
        return np.lexsort((self.instance, self.frame))

    @property
    def by_instance(self) -> NDArray[np.int64]:
        """(R,) row order by instance, then frame: the order of the artifact."""
        return np.lexsort((self.frame, self.instance))


def join_views(parts: Sequence[InstanceViews]) -> InstanceViews:
    """Concatenate views."""
    return InstanceViews(np.concatenate([np.zeros((0, 7), np.int32), *(views.table for views in parts)]))


def find_regions(labels: Labels, count: int, frame: int = 0) -> InstanceViews:
    """Find the instances that a frame shows, in ascending order. ``labels`` are (L, H, W) int32 instances at
    each level, below ``count``, -1 for none; an instance belongs to one level."""
    table = np.zeros((count, 7), np.int32)
    table[:, 0], table[:, 1] = np.arange(count), frame
    table[:, 2] = np.bincount(labels.ravel() + 1, minlength=count + 1)[1:]
    for level in labels:
        # find_objects ignores label 0, which is "no instance" here.
        for instance, place in enumerate(ndimage.find_objects(level + 1)):
            if place is not None:
                rows, columns = place
                table[instance, 3:] = columns.start, rows.start, columns.stop, rows.stop
    return InstanceViews(table[table[:, 2] > 0])


def cut_crop(
    rgb: Pixels, labels: Labels, instance: int, box: NDArray[np.int32], *, hull: bool = False
) -> Pixels:
    """Cut the square around an instance's box x0, y0, x1, y1 [px], black outside its mask, or outside the
    convex hull of it. ``rgb`` and ``labels`` are (H, W, 3) uint8, and (H, W) at its level; the result as of
    ``pad_square``."""
    x0, y0, x1, y1 = (int(value) for value in box)
    # Black outside the mask, as in LangSplat: the crop is S_i ⊙ I of the paper.
    mask = labels[y0:y1, x0:x1] == instance
    return pad_square(rgb[y0:y1, x0:x1] * (fill_hull(mask) if hull else mask)[..., None])


def pad_square(picture: Pixels) -> Pixels:
    """Pad an (H, W, 3) picture with black to a square; it is in the middle, half a pixel up or left if the sides differ by an odd number."""
    height, width = picture.shape[:2]
    side = max(height, width)
    top, left = (side - height) // 2, (side - width) // 2
    square = np.zeros((side, side, 3), np.uint8)
    square[top : top + height, left : left + width] = picture
    return square


def fill_hull(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill the convex hull of the pixels of an (H, W) mask; without a pixel, the hull is empty."""
    rows, columns = np.nonzero(mask)
    filled = np.zeros(mask.shape, np.uint8)
    if len(rows):
        hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
        cv2.fillConvexPoly(filled, hull, 1)
    return filled > 0


def resize(crop: Pixels, size: tuple[int, int], interpolation: str) -> Pixels:
    """Resize an (S, S, 3) crop to height and width [px], with a resampling of OpenCLIP's: ``bicubic`` or ``bilinear``."""
    if crop.shape[:2] == size:
        return crop
    return np.asarray(Image.fromarray(crop).resize((size[1], size[0]), RESAMPLING[interpolation]))


def encode(clip: OpenClip, crops: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Encode (B, H, W, 3) uint8 crops at the model's size, B >= 1.

    Returns:
        (B, D) float32 of unit norm; NaN for a crop whose feature is zero or not finite.
    """
    wanted = clip.preprocessing
    device = clip.compute.device
    mean, std = (torch.tensor(values, device=device)[:, None, None] for values in (wanted.mean, wanted.std))
    with clip.compute.inference():
        pictures = torch.from_numpy(crops).to(device).permute(0, 3, 1, 2).float() / 255.0
        features = clip.model.encode_image((pictures - mean) / std).float().cpu().numpy()
    good = usable(features)
    # NaN marks a view without a feature for the caller; zeros take its place while the others are normalized.
    return np.where(good[:, None], unit(np.where(good[:, None], features, 0.0)), np.nan).astype(np.float32)


def channels(clip: OpenClip) -> int:
    """Return D, the number of channels of the model's features."""
    # Encoding a black image works for every architecture of the image tower.
    return encode(clip, np.zeros((1, *clip.preprocessing.image_size, 3), np.uint8)).shape[1]


def find_views(
    frames: Artifact, instances: Artifact, min_area: float, max_views: int | None, chunks: list[range]
) -> InstanceViews:
    """Find the views to encode in chunks of frames, sorted by instance, then frame. ``min_area`` is the
    smallest mask as a fraction of the image, at least one pixel; ``max_views`` the largest number of views
    per instance, evenly spaced, None for all."""
    count = instances.shape("instances/level")[0]
    _, _, height, width = instances.shape("labels")
    # An instance without a pixel has no crop, even if ``min_area`` is 0.
    least = max(1.0, min_area * height * width)
    # Training frames only: evaluation frames must not influence the result.
    trained = np.flatnonzero(frames.read("train"))
    found = []
    for frame in track(trained[lie_within(trained, chunks)], "finding instances"):
        shown = find_regions(instances.row("labels", frame), count, int(frame))
        found.append(shown.chosen(shown.area >= least))
    views = join_views(found)
    views = views.chosen(views.by_instance)
    return views if max_views is None else views.chosen(spread(views.instance, max_views))


def split_batches(views: InstanceViews, chunks: list[range], size: int) -> list[InstanceViews]:
    """Split views in the order ``by_frame`` into batches of at most ``size``, none of which goes beyond a chunk."""
    ends = np.searchsorted(views.frame, [chunk.stop for chunk in chunks])
    return [
        views.chosen(slice(begin, min(begin + size, end)))
        for first, end in pairwise([0, *ends])
        for begin in range(first, end, size)
    ]


def spread(instance: Ints, most: int) -> NDArray[np.bool_]:
    """(R,) bool: at most ``most`` evenly spaced rows per sorted instance (R,), always including the first."""
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    place = np.arange(len(instance)) - np.repeat(first, counts)
    total = np.repeat(np.maximum(counts, most), counts)
    # A row is kept where place * most / total reaches the next integer.
    return place * most // total != (place - 1) * most // total


def cut_crops(
    frames: Artifact, instances: Artifact, views: InstanceViews, wanted: Preprocessing, *, hull: bool
) -> Iterator[NDArray[np.uint8]]:
    """Yield the upright (H, W, 3) uint8 crop of each view, ``by_frame``, at the model's size; holds one frame at a time."""
    level = instances.read("instances/level")
    turned = lies_on_its_side(frames)
    at = -1
    for frame, instance, box in zip(views.frame, views.instance, views.box, strict=True):
        # Each frame is decompressed once, because the views are in the order of the frames.
        if frame != at:
            rgb, labels, at = frames.row("rgb", frame), instances.row("labels", frame), frame
        crop = cut_crop(rgb, labels[level[instance]], instance, box, hull=hull)
        # CLIP is not invariant to rotation, and Aria's first generation films sideways (docs/method.md#upright).
        yield resize(np.rot90(crop, -1) if turned else crop, wanted.image_size, wanted.interpolation)
