"""Find the views of instances, cut their crops and encode them with OpenCLIP (docs/method.md#crops)."""

from collections.abc import Iterator
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

# OpenCLIP's preprocessing uses PIL's resampling, which smooths when it shrinks an image; OpenCV's does not.
RESAMPLING = {"bicubic": Image.Resampling.BICUBIC, "bilinear": Image.Resampling.BILINEAR}


@dataclass(frozen=True)
class Regions:
    """The K instances visible in a frame.

    Attributes:
        instance: (K,) int32, ascending.
        area: (K,) int32 pixels.
        box: (K, 4) int32 x0, y0, x1, y1 [px], exclusive ends.
    """

    instance: NDArray[np.int32]
    area: NDArray[np.int32]
    box: NDArray[np.int32]

    def chosen(self, which: NDArray[np.bool_]) -> "Regions":
        """Select regions by a mask."""
        return Regions(self.instance[which], self.area[which], self.box[which])


def find_regions(labels: Labels, count: int) -> Regions:
    """Find area and bounding box of each instance in a frame.

    Args:
        labels: (L, H, W) int32 instance at each level, -1 for none; an instance belongs to one level.
        count: number of instances; labels are below it.
    """
    area = np.bincount(labels.ravel() + 1, minlength=count + 1)[1:]
    box = np.zeros((count, 4), np.int32)
    for level in labels:
        # find_objects ignores label 0, which is "no instance" here.
        for instance, found in enumerate(ndimage.find_objects(level + 1)):
            if found is not None:
                rows, columns = found
                box[instance] = columns.start, rows.start, columns.stop, rows.stop
    seen = np.flatnonzero(area)
    return Regions(seen.astype(np.int32), area[seen].astype(np.int32), box[seen])


def cut_crop(
    rgb: Pixels, labels: Labels, instance: int, box: NDArray[np.int32], *, hull: bool = False
) -> Pixels:
    """Cut the square around an instance's bounding box, black outside its mask.

    Args:
        rgb: (H, W, 3) uint8.
        labels: (H, W) at the instance's level.
        box: (4,) x0, y0, x1, y1 [px].
        hull: black outside the convex hull of the mask instead.

    Returns:
        (S, S, 3) uint8, S the longer side of the box. The box is centered, half a pixel up or left if the sides
        differ by an odd number.
    """
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
    """Resize a square crop to the model's input, with the resampling of OpenCLIP's preprocessing.

    Args:
        crop: (S, S, 3) uint8.
        size: height and width [px].
        interpolation: ``bicubic`` or ``bilinear``.
    """
    if crop.shape[:2] == size:
        return crop
    return np.asarray(Image.fromarray(crop).resize((size[1], size[0]), RESAMPLING[interpolation]))


def encode(clip: OpenClip, crops: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Encode a batch of crops.

    Args:
        crops: (B, H, W, 3) uint8 at the model's size, B >= 1.

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


Ints = NDArray[np.int32]


@dataclass(frozen=True)
class InstanceViews:
    """R views.

    Attributes:
        instance, frame, area: (R,) int32.
        box: (R, 4) int32 x0, y0, x1, y1 [px].
    """

    instance: Ints
    frame: Ints
    area: Ints
    box: Ints

    def __len__(self) -> int:
        return len(self.instance)

    @staticmethod
    def of_table(table: Ints) -> "InstanceViews":
        """Take the columns of a ``table``."""
        return InstanceViews(table[:, 0], table[:, 1], table[:, 2], table[:, 3:])

    @property
    def table(self) -> Ints:
        """(R, 7) int32: instance, frame, area and box."""
        return np.column_stack([self.instance, self.frame, self.area, self.box])

    def chosen(self, which: NDArray | slice) -> "InstanceViews":
        """Select views by a mask or row indices."""
        return InstanceViews(self.instance[which], self.frame[which], self.area[which], self.box[which])

    @property
    def by_frame(self) -> NDArray[np.int64]:
        """(R,) row order by frame, then instance: the order of encoding."""
        return np.lexsort((self.instance, self.frame))

    @property
    def by_instance(self) -> NDArray[np.int64]:
        """(R,) row order by instance, then frame: the order of the artifact."""
        return np.lexsort((self.frame, self.instance))


def join_views(parts: list[InstanceViews]) -> InstanceViews:
    """Concatenate views."""
    return InstanceViews.of_table(np.concatenate([np.zeros((0, 7), np.int32), *(one.table for one in parts)]))


def find_views(
    frames: Artifact, instances: Artifact, min_area: float, max_views: int | None, chunks: list[range]
) -> InstanceViews:
    """Find the views to encode, sorted by instance, then frame.

    Args:
        min_area: smallest mask as a fraction of the image; at least one pixel.
        max_views: largest number of views per instance, evenly spaced; None for all.
        chunks: the frames.
    """
    count = instances.shape("instances/level")[0]
    _, _, height, width = instances.shape("labels")
    # An instance without a pixel has no crop, even if ``min_area`` is 0.
    least = max(1.0, min_area * height * width)
    # Training frames only: evaluation frames must not influence the result.
    trained = np.flatnonzero(frames.read("train"))
    found = []
    for frame in track(trained[lie_within(trained, chunks)], "finding instances"):
        regions = find_regions(instances.row("labels", frame), count)
        regions = regions.chosen(regions.area >= least)
        at = np.full_like(regions.instance, frame)
        found.append(InstanceViews(regions.instance, at, regions.area, regions.box))
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
    """(R,) bool: at most ``most`` evenly spaced rows per instance, always including the first.

    Args:
        instance: (R,) sorted.
        most: at least 1.
    """
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    place = np.arange(len(instance)) - np.repeat(first, counts)
    total = np.repeat(np.maximum(counts, most), counts)
    # A row is kept where place * most / total reaches the next integer.
    return place * most // total != (place - 1) * most // total


def cut_crops(
    frames: Artifact, instances: Artifact, views: InstanceViews, wanted: Preprocessing, *, hull: bool
) -> Iterator[NDArray[np.uint8]]:
    """Yield the upright (H, W, 3) uint8 crop of each view at the model's size; holds one frame at a time.

    Args:
        views: in the order ``by_frame``.
        hull: as in ``cut_crop``.
    """
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
