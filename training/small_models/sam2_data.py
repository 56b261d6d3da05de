"""Random training samples for SAM2 from rendered worlds: images, prompts and targets."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.small_models.levels import LEVELS
from training.small_models.worlds import RenderedWorld

# Default side of the model's input [px].
SIDE = 256

# Pixels of the input per cell, for the model's masks and for the targets that define their IoU. The coarse
# cells distinguish small masks too badly for the latter.
COARSE, FINE = 4, 2

_LEAST_PIXELS = 12

# Smaller shares of the image are prompted less often.
_SMALL = 0.001

# Probability of each level to be prompted.
_PROMPTED = (0.25, 0.25, 0.5)

# Normalization of the published SAM2.
_MEAN, _STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)

Rng = np.random.Generator
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Clip:
    """Consecutive images of one world with the same cut and size.

    Attributes:
        pictures: (T, S, S, 3) uint8.
        labels: (3, T, S, S) int32 number of subpart, part and whole; -1 for none.
        names: (T, S, S) int32 name of the part, an index into the vocabulary; -1 for none.
    """

    pictures: Bytes
    labels: Ints
    names: Ints


@dataclass(frozen=True, eq=False)
class Prompts:
    """Points in one image and their targets.

    Attributes:
        points: (K, 2) float32 pixel (x, y), centers at integer + 0.5.
        coarse, fine: (K, 3, M, M) and (K, 3, N, N) float32 fraction of each cell that the level's mask covers.
        present: (K,) bool: whether there is an object at the point.
    """

    points: Tensor
    coarse: Tensor
    fine: Tensor
    present: Tensor


@dataclass(frozen=True, eq=False)
class Tracks:
    """Masks to propagate through a clip.

    Attributes:
        prompt: (K, 1, S, S) float32 mask for the first frame, slightly wrong on purpose.
        coarse, fine: (T, K, M, M) and (T, K, N, N) float32 covered fraction of each cell.
        present: (T, K) bool: whether enough of it is visible.
    """

    prompt: Tensor
    coarse: Tensor
    fine: Tensor
    present: Tensor


def vocabulary(worlds: Sequence[RenderedWorld]) -> dict[str, int]:
    """Index of every part name in any world; numbers at the end of a name are ignored."""
    names = {_name(one) for world in worlds for one in world.part_names}
    return {name: number for number, name in enumerate(sorted(names))}


def _name(part: str) -> str:
    return part.rstrip("0123456789 ")


def sample_clip(
    worlds: Sequence[RenderedWorld],
    words: dict[str, int],
    rng: Rng,
    frames: int,
    still: float = 0.0,
    side: int = SIDE,
) -> Clip:
    """Draw a clip of ``frames`` images with random world, cut, size, direction of time and colors.

    Args:
        worlds: source of the clip; words: see ``vocabulary``; rng: source of randomness; frames: length.
        still: probability of a single image seen through a drifting cut, which is easier to propagate through.
        side: of the images [px].
    """
    world = worlds[rng.integers(len(worlds))]
    clips, length, size = world.subpart.shape[:3]
    clip, first = rng.integers(clips), rng.integers(length - frames + 1)
    order = np.arange(first, first + frames)
    if rng.random() < 0.5:
        order = order[::-1]
    boxes = [_random_box(rng, size)] * frames
    if rng.random() < still:
        order, boxes = np.full(frames, first), _drifting(boxes[0], rng, size, frames)
    flip = rng.random() < 0.5
    pictures, subparts = [], []
    for frame, (top, left, height, width) in zip(order, boxes, strict=True):
        rows, columns = np.s_[top : top + height], np.s_[left : left + width]
        rgb, subpart = world.rgb[clip, frame, rows, columns], world.subpart[clip, frame, rows, columns]
        shrinks = max(height, width) > side
        picture = cv2.resize(rgb, (side, side), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        label = cv2.resize(subpart, (side, side), interpolation=cv2.INTER_NEAREST)
        pictures.append(picture[:, ::-1] if flip else picture)
        subparts.append(label[:, ::-1] if flip else label)
    labels = world.labels(np.stack(subparts))
    # Index -1, no part, picks the last entry: no name.
    called = np.array([words[_name(part)] for part in world.part_names] + [-1], np.int32)
    return Clip(_change_colors(np.stack(pictures), rng), labels, called[labels[1]])


def _random_box(rng: Rng, size: int) -> tuple[int, int, int, int]:
    """Top, left, height and width of a cut of the image, or of the square in its circle: photographs have no black corners."""
    draw, margin = rng.random(), 0
    if draw < 0.2:
        return 0, 0, size, size
    if draw < 0.7:
        margin = round(size * (1 - np.sqrt(0.5)) / 2)
    most = size - 2 * margin
    side = most * np.exp(rng.uniform(np.log(0.45), 0.0))
    # Photographs are wider or higher than the square that SAM2 sees.
    ratio = np.exp(rng.uniform(-0.3, 0.3))
    height, width = (int(np.clip(side * factor, 32, most)) for factor in (ratio, 1 / ratio))
    top, left = (margin + rng.integers(most - span + 1) for span in (height, width))
    return top, left, height, width


def _drifting(box: tuple[int, int, int, int], rng: Rng, size: int, frames: int) -> list[tuple[int, ...]]:
    """A slightly smaller cut that moves in one direction by up to a tenth of its side per frame."""
    top, left, height, width = box
    height, width = round(0.8 * height), round(0.8 * width)
    speed = rng.uniform(-0.1, 0.1, 2) * (height, width)
    places = (np.array([top, left]) + np.arange(frames)[:, None] * speed).round().astype(int)
    places = places.clip(0, [size - height, size - width])
    return [(int(y), int(x), height, width) for y, x in places]


def _change_colors(pictures: Bytes, rng: Rng) -> Bytes:
    """Randomly change channel order, gain, offset, gamma, saturation, blur, noise, and what JPEG loses."""
    x = pictures.astype(np.float32) / 255
    if rng.random() < 0.25:
        x = x[..., rng.permutation(3)]
    if rng.random() < 0.8:
        gain, shift = rng.uniform(0.75, 1.25, 3) * rng.uniform(0.8, 1.2), rng.uniform(-0.05, 0.05)
        x = np.clip(x * gain.astype(np.float32) + np.float32(shift) * (x > 0), 0, 1) ** np.float32(
            np.exp(rng.uniform(-0.25, 0.25))
        )
    if rng.random() < 0.3:
        gray = x.mean(-1, keepdims=True)
        x = np.clip(gray + (x - gray) * np.float32(rng.uniform(0.2, 1.4)), 0, 1)
    if rng.random() < 0.2:
        sigma = rng.uniform(0.4, 1.2)
        x = np.stack([cv2.GaussianBlur(picture, (0, 0), sigma) for picture in x])
    if rng.random() < 0.3:
        x = x + rng.normal(0, rng.uniform(0.005, 0.03), x.shape).astype(np.float32)
    made = (np.clip(x, 0, 1) * 255 + 0.5).astype(np.uint8)
    if rng.random() < 0.4:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 95))]
        made = np.stack([cv2.imdecode(cv2.imencode(".jpg", one, quality)[1], 1) for one in made])
    return made


def to_input(pictures: Bytes) -> Tensor:
    """(T, S, S, 3) uint8 -> (T, 3, S, S) float32, normalized for the model."""
    return torch.from_numpy((pictures.astype(np.float32) / 255 - _MEAN) / _STD).permute(0, 3, 1, 2)


def sample_prompts(labels: Ints, rng: Rng, count: int) -> Prompts:
    """Draw points in one image with ``labels`` (3, S, S): on pieces of all sizes, and some on none.

    70 % of the points are on a piece of a random level, drawn by ``_piece_weights``; the others are anywhere.
    """
    weights = [_piece_weights(each) for each in labels]
    points, coarse, fine, present = [], [], [], []
    for number in range(count):
        level = int(rng.choice(len(LEVELS), p=_PROMPTED))
        if number < 0.7 * count and weights[level].any():
            chosen = rng.choice(len(weights[level]), p=weights[level])
            places = np.flatnonzero(labels[level] == chosen)
            y, x = divmod(int(places[rng.integers(len(places))]), labels.shape[2])
        else:
            y, x = rng.integers(labels.shape[1]), rng.integers(labels.shape[2])
        values = labels[:, y, x]
        masks = (labels == values[:, None, None]) & (values >= 0)[:, None, None]
        points.append((x + 0.5, y + 0.5))
        coarse.append(share_covered(masks, COARSE))
        fine.append(share_covered(masks, FINE))
        present.append(values[0] >= 0)
    stacked = (torch.from_numpy(np.stack(each)) for each in (coarse, fine))
    return Prompts(torch.tensor(points, dtype=torch.float32), *stacked, torch.tensor(present))


def _piece_weights(labels: Ints) -> NDArray[np.float64]:
    """(N,) probability of each piece of a level in one image with ``labels`` (S, S); all 0 if there are none.

    Proportional to perimeter / sqrt(area): equal for all sizes, larger for thin pieces. Below 0.1 % of the image it
    falls with the area.
    """
    areas, outlines = np.bincount(labels.ravel() + 1)[1:], perimeters(labels)
    weights = outlines / np.sqrt(np.maximum(areas, 1)) * np.minimum(1, areas / (_SMALL * labels.size))
    weights[areas < _LEAST_PIXELS] = 0
    return weights / max(weights.sum(), 1e-9)


def perimeters(labels: Ints) -> NDArray[np.int64]:
    """(N,) number of pixel sides of each label of (H, W) labels, -1 for none, where another label or none begins."""
    count = labels.max() + 2
    total = np.zeros(count, np.int64)
    for one, other in ((labels[1:], labels[:-1]), (labels[:, 1:], labels[:, :-1])):
        differs = one != other
        total += np.bincount(one[differs] + 1, minlength=count)
        total += np.bincount(other[differs] + 1, minlength=count)
    return total[1:]


def sample_tracks(clip: Clip, rng: Rng, count: int) -> Tracks:
    """Draw masks to propagate, of all levels, more often of wholes and movable objects; hide some temporarily.

    The occluder is painted into ``clip.pictures``, and the hidden object is removed from ``clip.labels``.
    """
    chosen = []
    for _ in range(count):
        level = int(rng.choice(len(LEVELS), p=(0.2, 0.25, 0.55)))
        values, areas = np.unique(clip.labels[level, 0], return_counts=True)
        kept = (values >= 0) & (areas >= 4 * _LEAST_PIXELS)
        if kept.any():
            weights = 1 / np.sqrt(areas[kept])
            chosen.append((level, rng.choice(values[kept], p=weights / weights.sum())))
    # Before the masks are read: an occluder changes the labels.
    for level, value in chosen:
        if rng.random() < 0.25:
            _hide(clip, level, value, rng)
    masks = np.stack([clip.labels[level] == value for level, value in chosen], axis=1)
    prompt = np.stack([_wrong(mask, rng) for mask in masks[0]])[:, None]
    return Tracks(
        torch.from_numpy(prompt),
        torch.from_numpy(share_covered(masks, COARSE)),
        torch.from_numpy(share_covered(masks, FINE)),
        torch.from_numpy(masks.sum(axis=(2, 3)) >= _LEAST_PIXELS),
    )


def _hide(clip: Clip, level: int, value: int, rng: Rng) -> None:
    """Cover a mask in one or two frames after the first with a piece of the image from elsewhere."""
    count, side = clip.pictures.shape[:2]
    first = int(rng.integers(1, count))
    for frame in range(first, min(count, first + int(rng.integers(1, 3)))):
        rows, columns = np.nonzero(clip.labels[level, frame] == value)
        # A large object cannot be hidden by a piece of the image.
        if len(rows) == 0 or (np.ptp(rows) + 1) * (np.ptp(columns) + 1) > 0.15 * side * side:
            continue
        margin = int(rng.integers(0, 6))
        top, left = max(0, rows.min() - margin), max(0, columns.min() - margin)
        height, width = rows.max() + 1 + margin - top, columns.max() + 1 + margin - left
        height, width = min(height, side - top), min(width, side - left)
        y, x = rng.integers(side - height + 1), rng.integers(side - width + 1)
        patch = clip.pictures[0, y : y + height, x : x + width].copy()
        clip.pictures[frame, top : top + height, left : left + width] = patch
        clip.labels[:, frame, top : top + height, left : left + width] = -1
        clip.names[frame, top : top + height, left : left + width] = -1


def _wrong(mask: NDArray[np.bool_], rng: Rng) -> NDArray[np.float32]:
    """Grow or shrink a mask by up to two pixels, as a segmenter might; the result is never empty."""
    radius = int(rng.integers(-2, 3))
    if radius == 0:
        return mask.astype(np.float32)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(radius) + 1,) * 2)
    changed = (cv2.dilate if radius > 0 else cv2.erode)(mask.astype(np.uint8), kernel)
    return (changed if changed.sum() >= _LEAST_PIXELS else mask).astype(np.float32)


def share_covered(masks: NDArray[np.bool_], cell: int) -> NDArray[np.float32]:
    """(..., S, S) masks -> (..., S / cell, S / cell) covered fraction of each cell, to within 1/255."""
    side = masks.shape[-1] // cell
    flat = masks.reshape(-1, *masks.shape[-2:]).astype(np.uint8) * np.uint8(255)
    cells = [cv2.resize(mask, (side, side), interpolation=cv2.INTER_AREA) for mask in flat]
    return np.stack(cells).reshape(*masks.shape[:-2], side, side).astype(np.float32) / np.float32(255)
