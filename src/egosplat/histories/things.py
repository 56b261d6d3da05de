"""Which rests and carries are of one thing, and what it looks like."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from egosplat.features.aggregation import aggregate
from egosplat.features.crops import channels, encode, fill_hull, pad_square, resize
from egosplat.histories.fitting import improved
from egosplat.histories.places import PlaceView, Scenery
from egosplat.histories.rests import Rest
from egosplat.images import evenly_spaced
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip

# Things whose features have this cosine look alike; they are two if rests of both last at once, at places that do not touch, for more
# than this part of one.
_ALIKE, _AT_ONCE = 0.85, 0.25
# Outliers among rests and carries of a thing: see ``aggregate``.
_AGGREGATION = ("cosine", 2.0)
# Views of a rest that OpenCLIP encodes, and the smallest thing among them [px].
_VIEWS, _LEAST_PIXELS = 16, 50


@dataclass(frozen=True, eq=False)
class Look:
    """How a rest looks.

    Attributes:
        frame: the frame that shows most of it.
        box: x0, y0, x1, y1 around it there [px].
        feature: (D,) float64 mean of OpenCLIP's features of its views, of unit norm; zeros without one.
    """

    frame: int
    box: tuple[int, int, int, int]
    feature: NDArray[np.float64]


def find_things(
    rests: Sequence[Rest], looks: Sequence[Look], links: NDArray[np.int32], carried: NDArray[np.float32]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Find the thing of each rest and of each carry by ``group`` and ``match``, with ``features_of`` each thing.

    Args:
        links: as ``link`` returns them.
        carried: (C, D) feature of each carry; zeros without one.
    """
    things, of_carries = group(len(rests), links)
    if not rests:
        return things, of_carries, np.zeros((0, carried.shape[1]), np.float32)
    parts = features_of(things, looks, of_carries, carried)
    things, of_carries = match(things, of_carries, rests, parts)
    return things, of_carries, features_of(things, looks, of_carries, carried)


def group(rests: int, links: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Number the things: a carry is of one thing with the rests before and after it, see ``link``.

    Returns:
        (R,) int32 thing of each rest, and (C,) of each carry, -1 for a carry without a rest.
    """
    carries = links.shape[1]
    side, carry = np.nonzero(links >= 0)
    nodes = rests + carries
    joined = coo_array((np.ones(len(side), bool), (links[side, carry], rests + carry)), shape=(nodes, nodes))
    label = connected_components(joined, directed=False)[1]
    numbers, thing = np.unique(label[:rests], return_inverse=True)
    # Components without a rest are single carries.
    of_carries = np.where(np.isin(label[rests:], numbers), np.searchsorted(numbers, label[rests:]), -1)
    return thing.astype(np.int32), of_carries.astype(np.int32)


def match(
    things: NDArray[np.int32],
    of_carries: NDArray[np.int32],
    rests: Sequence[Rest],
    features: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Join things that look alike and rest one after the other, or at one place: a carry between them was missed, or they are parts.

    Args:
        things, of_carries: as ``group`` returns them.
        features: (T, D) of the things, of unit norm or zeros.

    Returns:
        The same with fewer things.
    """
    alike = (features @ features.T).astype(np.float64)
    np.fill_diagonal(alike, -1.0)
    label = np.arange(len(features))
    # The most similar first; features stay those of the parts.
    for first, second in zip(*np.unravel_index(np.argsort(-alike, axis=None), alike.shape), strict=True):
        if alike[first, second] < _ALIKE:
            break
        one, other = label[first], label[second]
        of_both = [
            [rest for rest, thing in zip(rests, things, strict=True) if label[thing] == each]
            for each in (one, other)
        ]
        if one != other and not any(_are_two(*pair) for pair in itertools.product(*of_both)):
            label[label == other] = one
    numbers, label = np.unique(label, return_inverse=True)
    joined = label.astype(np.int32)
    of_both = np.where(of_carries >= 0, joined[of_carries] if len(numbers) else -1, -1)
    return joined[things], of_both.astype(np.int32)


def _are_two(rest: Rest, other: Rest) -> bool:
    """Whether two rests are of two things: seen in the same frames, more than at one end, at places that do not touch."""
    (first, last), (begin, end) = rest.frames, other.frames
    at_once = min(last, end) - max(first, begin) > min(last - first, end - begin) * _AT_ONCE
    apart = float(np.linalg.norm(rest.center - other.center))
    return at_once and apart > rest.place.radius + other.place.radius


def look_at(rest: Rest, scene: Scenery, clip: OpenClip, turned: bool) -> Look:
    """Encode what the frames show where the Gaussians of a rest explain them; ``turned`` pictures lie on their side."""
    views = [rest.views[place] for place in evenly_spaced(len(rest.views), _VIEWS)]
    masks = [improved(view, rest.gaussians, scene) for view in views]
    areas = [int(mask.sum()) for mask in masks]
    best = int(np.argmax(areas))
    wanted, crops = clip.preprocessing, []
    for view, mask, area in zip(views, masks, areas, strict=True):
        if area >= _LEAST_PIXELS:
            rows, columns = _slices(mask)
            hull = fill_hull(mask[rows, columns])[..., None]
            square = pad_square(view.picture[rows, columns] * hull)
            square = np.rot90(square, -1) if turned else square
            crops.append(resize(square, wanted.image_size, wanted.interpolation))
    features = encode(clip, np.stack(crops)) if crops else np.zeros((0, channels(clip)), np.float32)
    mean = unit(features[usable(features)].astype(np.float64).sum(axis=0))
    return Look(views[best].frame, _box(views[best], masks[best]), mean)


def features_of(
    things: NDArray[np.int32],
    looks: Sequence[Look],
    of_carries: NDArray[np.int32],
    carried: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(T, D) mean feature of each thing's rests and carries without outliers, of unit norm or zeros: a hand is in some of them."""
    every = np.stack([*(look.feature for look in looks), *carried.astype(np.float64)])
    owner = np.concatenate([things, of_carries])
    rows = np.flatnonzero(usable(every) & (owner >= 0))
    rows = rows[np.argsort(owner[rows], kind="stable")]
    count = int(things.max(initial=-1)) + 1
    return unit(aggregate(every[rows], owner[rows], count, *_AGGREGATION).feature).astype(np.float32)


def _slices(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _box(view: PlaceView, mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """The box around a mask in the frame; around the crop without a pixel."""
    left, top = view.corner
    if not mask.any():
        return left, top, left + view.camera.width, top + view.camera.height
    rows, columns = _slices(mask)
    return left + columns.start, top + rows.start, left + columns.stop, top + rows.stop
