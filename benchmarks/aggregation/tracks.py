"""Objects of held-out worlds with the features of their views, and views replaced by wrong ones."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.features.crops import cut_crop, encode, find_regions, resize
from egosplat.models.clip import OpenClip
from egosplat.progress import track
from training.small_models.worlds import RenderedWorld

# Least share of the frame that a view covers.
LEAST_SHARE = 0.0004

# Least number of views of an object.
LEAST_VIEWS = 6

_BATCH = 64
_WHOLE = 2

Features = NDArray[np.float32]


KINDS = {
    "switched": "the tracker slips onto one other thing",
    "scattered": "each wrong view shows a different thing",
    "slid": "the mask slides off the thing",
}


@dataclass(frozen=True, eq=False)
class Tracks:
    """R views of N objects.

    Attributes:
        world, name: (N,) seed and name of each object.
        thing: (R,) object of each view, ascending.
        feature: (R, D) of the view; shifted: (R, D) of the same frame with the mask slid off the object.
    """

    world: NDArray[np.int64]
    name: NDArray[np.str_]
    thing: NDArray[np.int64]
    feature: Features
    shifted: Features


def find_tracks(worlds: list[RenderedWorld], names: set[str], clip: OpenClip) -> Tracks:
    """The tracks of all objects with one of these names and enough views."""
    world_of, name_of, things, right, wrong = [], [], [], [], []
    for number, world in enumerate(track(worlds, "encoding worlds", unit="world")):
        crops = list(_crops(world, names, clip))
        if not crops:
            continue
        whole = np.array([one[0] for one in crops])
        features = _encoded(clip, [one[1] for one in crops]), _encoded(clip, [one[2] for one in crops])
        for value in np.unique(whole):
            rows = np.flatnonzero(whole == value)
            if len(rows) < LEAST_VIEWS:
                continue
            things.append(np.full(len(rows), len(name_of)))
            world_of.append(number)
            name_of.append(world.names[value])
            right.append(features[0][rows])
            wrong.append(features[1][rows])
    joined = (np.concatenate(parts) for parts in (things, right, wrong))
    return Tracks(np.array(world_of), np.array(name_of), *joined)


def _crops(
    world: RenderedWorld, names: set[str], clip: OpenClip
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8]]]:
    """Object, crop, and crop with the slid mask, of every view of every frame."""
    wanted = clip.preprocessing
    for pictures, subparts in zip(world.rgb, world.subpart, strict=True):
        for rgb, subpart in zip(pictures, subparts, strict=True):
            labels = world.labels(subpart)[_WHOLE].astype(np.int32)
            found = find_regions(labels[None], len(world.names))
            for thing, area, box in zip(found.instance, found.area, found.box, strict=True):
                if world.names[thing] not in names or area < LEAST_SHARE * labels.size:
                    continue
                pair = (labels, box), slid(labels, box, thing)
                crops = (cut_crop(np.asarray(rgb), mask, thing, where) for mask, where in pair)
                yield thing, *(resize(crop, wanted.image_size, wanted.interpolation) for crop in crops)


def slid(
    labels: NDArray[np.int32], box: NDArray[np.int32], thing: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The mask of an object, moved by its own size towards the center of the frame, and its new box."""
    height, width = labels.shape
    x0, y0, x1, y1 = (int(value) for value in box)
    dx = (x1 - x0) * (1 if x0 + x1 < width else -1)
    dy = (y1 - y0) * (1 if y0 + y1 < height else -1)
    dx, dy = int(np.clip(dx, -x0, width - x1)), int(np.clip(dy, -y0, height - y1))
    moved = np.full_like(labels, -1)
    moved[y0 + dy : y1 + dy, x0 + dx : x1 + dx] = labels[y0:y1, x0:x1]
    return moved, np.array([x0 + dx, y0 + dy, x1 + dx, y1 + dy], np.int32)


def _encoded(clip: OpenClip, crops: list[NDArray[np.uint8]]) -> Features:
    parts = [np.stack(crops[first : first + _BATCH]) for first in range(0, len(crops), _BATCH)]
    return np.concatenate([encode(clip, part) for part in parts])


def corrupted(tracks: Tracks, kind: str, share: float, rng: np.random.Generator) -> Features:
    """(R, D) features with this share of each object's views replaced by wrong ones.

    Wrong views of the kinds ``switched`` and ``scattered`` show objects of the same world with another name.
    """
    features = tracks.feature.copy()
    for thing, name in enumerate(tracks.name):
        rows = np.flatnonzero(tracks.thing == thing)
        wrong = rng.permutation(rows)[: round(share * len(rows))]
        if kind == "slid":
            features[wrong] = tracks.shifted[wrong]
            continue
        others = np.flatnonzero((tracks.world == tracks.world[thing]) & (tracks.name != name))
        if not len(others):
            continue
        one = kind == "switched"
        chosen = np.full(len(wrong), rng.choice(others)) if one else rng.choice(others, len(wrong))
        for row, other in zip(wrong, chosen, strict=True):
            features[row] = tracks.feature[rng.choice(np.flatnonzero(tracks.thing == other))]
    return features
