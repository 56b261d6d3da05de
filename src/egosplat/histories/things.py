"""Which rests and carries are of one thing, and what it looks like."""

import itertools
from collections.abc import Sequence

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from egosplat.arrays import Array, Floats, Ints32
from egosplat.features.aggregation import aggregate
from egosplat.features.crops import encode_crops, fill_hull, pad_square
from egosplat.histories.fitting import improved
from egosplat.histories.rests import Rest
from egosplat.language.vectors import unit, usable
from egosplat.models.clip import OpenClip

# Things whose features have this cosine look alike; they are two if rests of both last at once, at places that do not touch, for more
# than this part of one.
_ALIKE, _AT_ONCE = 0.85, 0.25
# Outliers among rests and carries of a thing: see ``aggregate``.
_AGGREGATION = ("cosine", 2.0)
# The smallest thing that OpenCLIP encodes [px].
_LEAST_PIXELS = 50


def find_things(
    rests: Sequence[Rest], looks: Sequence[Array], links: Ints32, carried: Floats
) -> tuple[Ints32, Ints32, Floats]:
    """Find the thing of each rest and of each carry by ``group`` and ``match``, with ``features_of`` each thing, from the (D,)
    features of rests and (C, D) of carries, zeros without one, and what ``link`` returns."""
    things, of_carries = group(len(rests), links)
    if not rests:
        return things, of_carries, np.zeros((0, carried.shape[1]), np.float32)
    every = np.stack([*looks, *carried.astype(np.float64)])
    things, of_carries = match(things, of_carries, rests, features_of(np.append(things, of_carries), every))
    return things, of_carries, features_of(np.append(things, of_carries), every)


def group(rests: int, links: Ints32) -> tuple[Ints32, Ints32]:
    """Number the things: (R,) int32 of each rest, and (C,) of each carry, which is one with the rests before and after it, see
    ``link``; -1 without a rest."""
    side, carry = np.nonzero(links >= 0)
    nodes = rests + links.shape[1]
    joined = coo_array((np.ones(len(side), bool), (links[side, carry], rests + carry)), shape=(nodes, nodes))
    label = connected_components(joined, directed=False)[1]
    numbers, thing = np.unique(label[:rests], return_inverse=True)
    # Components without a rest are single carries.
    of_carries = np.where(np.isin(label[rests:], numbers), np.searchsorted(numbers, label[rests:]), -1)
    return thing.astype(np.int32), of_carries.astype(np.int32)


def match(
    things: Ints32, of_carries: Ints32, rests: Sequence[Rest], features: Floats
) -> tuple[Ints32, Ints32]:
    """Join things of ``group`` that look alike by (T, D) features, of unit norm or zeros, and rest one after the other, or at
    one place: a carry between them was missed, or they are parts."""
    alike = (features @ features.T).astype(np.float64)
    np.fill_diagonal(alike, -1.0)
    label = np.arange(len(features))
    # The most similar first; features stay those of the parts.
    for first, second in zip(*np.unravel_index(np.argsort(-alike, axis=None), alike.shape), strict=True):
        if alike[first, second] < _ALIKE:
            break
        pair = label[first], label[second]
        of_both = [itertools.compress(rests, label[things] == one) for one in pair]
        if pair[0] != pair[1] and not any(itertools.starmap(_are_two, itertools.product(*of_both))):
            label[label == pair[1]] = pair[0]
    joined = np.unique(label, return_inverse=True)[1].astype(np.int32)
    return joined[things], np.where(of_carries >= 0, joined[of_carries], -1).astype(np.int32)


def _are_two(rest: Rest, other: Rest) -> bool:
    """Whether two rests are of two things: seen in the same frames, more than at one end, at places that do not touch."""
    (first, last), (begin, end) = rest.frames, other.frames
    at_once = min(last, end) - max(first, begin) > min(last - first, end - begin) * _AT_ONCE
    apart = float(np.linalg.norm(rest.center - other.center))
    return at_once and apart > rest.radius + other.radius


def features_of(owner: Ints32, every: Array) -> Floats:
    """(T, D) mean of the (R + C, D) features of each thing's rests and carries, by ``owner``, -1 for none, without outliers, of unit
    norm or zeros: a hand is in some of them."""
    rows = np.flatnonzero(usable(every) & (owner >= 0))
    rows = rows[np.argsort(owner[rows], kind="stable")]
    count = int(owner.max(initial=-1)) + 1
    return unit(aggregate(every[rows], owner[rows], count, *_AGGREGATION).feature).astype(np.float32)


def look_at(rest: Rest, clip: OpenClip, turned: bool) -> tuple[int, tuple[int, int, int, int], Array]:
    """Encode what the frames show where the Gaussians of a rest explain them: the frame that shows most of it, x0, y0, x1, y1
    around it there [px], and the (D,) float64 mean feature of unit norm, zeros without one. ``turned`` pictures lie on their
    side."""
    views, masks = rest.views, [improved(view, rest.gaussians) for view in rest.views]
    areas = [int(mask.sum()) for mask in masks]
    crops = []
    for view, mask, area in zip(views, masks, areas, strict=True):
        if area >= _LEAST_PIXELS:
            left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
            cut = np.s_[top : top + height, left : left + width]
            square = pad_square(view.picture[cut] * fill_hull(mask[cut])[..., None])
            crops.append(np.rot90(square, -1) if turned else square)
    features = encode_crops(clip, crops)
    mean = unit(features[usable(features)].astype(np.float64).sum(axis=0))
    best = int(np.argmax(areas))
    view, mask = views[best], masks[best]
    # Around the crop without a pixel.
    left, top, width, height = cv2.boundingRect((mask if areas[best] else ~mask).astype(np.uint8))
    left, top = view.corner[0] + left, view.corner[1] + top
    return view.frame, (left, top, left + width, top + height), mean
