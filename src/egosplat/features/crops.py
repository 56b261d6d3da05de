"""Find the views of instances, cut their crops and encode them with OpenCLIP (docs/method.md#crops)."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from egosplat.arrays import Bools, Bytes, Floats, Ints32
from egosplat.artifacts.checkpoint import lie_within
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import lies_on_its_side
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.progress import track

# OpenCLIP's preprocessing uses PIL's resampling, which smooths when it shrinks an image; OpenCV's does not.
RESAMPLING = {"bicubic": Image.Resampling.BICUBIC, "bilinear": Image.Resampling.BILINEAR}

# An instance that a frame shows, with the pixels of its mask, and x0, y0, x1, y1 around these with exclusive ends [px].
VIEW = np.dtype([("instance", np.int32), ("frame", np.int32), ("area", np.int32), ("box", np.int32, (4,))])

# (R,) ``VIEW``, an np.recarray: columns are attributes.
InstanceViews = Any


def join_views(parts: Sequence[NDArray]) -> InstanceViews:
    """Concatenate views."""
    return np.concatenate([np.zeros(0, VIEW), *parts]).view(np.recarray)


def find_regions(labels: Ints32, count: int, frame: int = 0) -> InstanceViews:
    """Find the instances that a frame shows, in ascending order. ``labels`` are (L, H, W) int32 instances at
    each level, below ``count``, -1 for none; an instance belongs to one level."""
    views = np.zeros(count, VIEW).view(np.recarray)
    views.instance, views.frame = np.arange(count), frame
    views.area = np.bincount(labels.ravel() + 1, minlength=count + 1)[1:]
    for level in labels:
        # find_objects ignores label 0, which is "no instance" here.
        for instance, place in enumerate(ndimage.find_objects(level + 1)):
            if place is not None:
                rows, columns = place
                views.box[instance] = columns.start, rows.start, columns.stop, rows.stop
    return views[views.area > 0]


def cut_crop(rgb: Bytes, labels: Ints32, instance: int, box: Ints32, *, hull: bool = False) -> Bytes:
    """Cut the square around an instance's box x0, y0, x1, y1 [px], black outside its mask, or outside the
    convex hull of it. ``rgb`` and ``labels`` are (H, W, 3) uint8, and (H, W) at its level; the result as of
    ``pad_square``."""
    x0, y0, x1, y1 = (int(value) for value in box)
    # Black outside the mask, as in LangSplat: the crop is S_i ⊙ I of the paper.
    mask = labels[y0:y1, x0:x1] == instance
    return pad_square(rgb[y0:y1, x0:x1] * (fill_hull(mask) if hull else mask)[..., None])


def pad_square(picture: Bytes) -> Bytes:
    """Pad an (H, W, 3) picture with black to a square; it is in the middle, half a pixel up or left if the sides differ by an odd number."""
    height, width = picture.shape[:2]
    side = max(height, width)
    top, left = (side - height) // 2, (side - width) // 2
    return np.pad(picture, ((top, side - height - top), (left, side - width - left), (0, 0)))


def fill_hull(mask: Bools) -> Bools:
    """Fill the convex hull of the pixels of an (H, W) mask; without a pixel, the hull is empty."""
    rows, columns = np.nonzero(mask)
    filled = np.zeros(mask.shape, np.uint8)
    if len(rows):
        hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
        cv2.fillConvexPoly(filled, hull, 1)
    return filled > 0


def resize(crop: Bytes, size: tuple[int, int], interpolation: str) -> Bytes:
    """Resize an (S, S, 3) crop to height and width [px], with a resampling of OpenCLIP's: ``bicubic`` or ``bilinear``."""
    if crop.shape[:2] == size:
        return crop
    return np.asarray(Image.fromarray(crop).resize((size[1], size[0]), RESAMPLING[interpolation]))


def encode(clip: OpenClip, crops: Bytes) -> Floats:
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


def encode_crops(clip: OpenClip, crops: Sequence[Bytes]) -> Floats:
    """(B, D) features as of ``encode`` of (h, w, 3) uint8 crops of any shape, padded to squares; there may be none."""
    wanted = clip.preprocessing
    squares = [resize(pad_square(crop), wanted.image_size, wanted.interpolation) for crop in crops]
    return encode(clip, np.stack(squares)) if squares else np.zeros((0, channels(clip)), np.float32)


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
        found.append(shown[shown.area >= least])
    views = join_views(found)
    views = views[np.lexsort((views.frame, views.instance))]
    return views if max_views is None else views[spread(views.instance, max_views)]


def split_batches(views: InstanceViews, chunks: list[range], size: int) -> list[InstanceViews]:
    """Split views, sorted by frame, into batches of at most ``size``, none of which goes beyond a chunk."""
    ends = np.searchsorted(views.frame, [chunk.stop for chunk in chunks])
    return [
        views[begin : min(begin + size, end)]
        for first, end in pairwise([0, *ends])
        for begin in range(first, end, size)
    ]


def spread(instance: Ints32, most: int) -> Bools:
    """(R,) bool: at most ``most`` evenly spaced rows per sorted instance (R,), always including the first."""
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    place = np.arange(len(instance)) - np.repeat(first, counts)
    total = np.repeat(np.maximum(counts, most), counts)
    # A row is kept where place * most / total reaches the next integer.
    return place * most // total != (place - 1) * most // total


def cut_crops(
    frames: Artifact, instances: Artifact, views: InstanceViews, wanted: Preprocessing, *, hull: bool
) -> Iterator[Bytes]:
    """Yield the upright (H, W, 3) uint8 crop of each view, sorted by frame, at the model's size; holds one frame at a time."""
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
