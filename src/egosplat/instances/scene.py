"""The things of all levels of a scene, on its Gaussians."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from egosplat.arrays import Bools, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.instances.geometry import Geometry
from egosplat.instances.lifted_masks import lift
from egosplat.instances.moving import MovingTracks
from egosplat.instances.rendering import render_things
from egosplat.instances.things import beliefs, find_things
from egosplat.progress import log


@dataclass(frozen=True, eq=False)
class Scene:
    """K things on N Gaussians.

    Attributes:
        geometry: Gaussians that masks are merged on.
        shown: returns the (H, W) bool pixels of a frame that show the scene.
        beliefs: by level, (N, K_l) share of each Gaussian's weight in the masks of each thing of the level.
        level: (K,) int8 level of each thing; the things of a level follow each other.
        masks: (K,) int32 number of merged masks.
        named: (V,) int64 frame, number in segments.zarr, and thing of each mask, -1 for a mask that shows none.
        counts: numbers of masks, runs, ... by level, for the facts.
    """

    geometry: Geometry
    shown: Callable[[int], Bools]
    beliefs: list[sparse.csr_array]
    level: NDArray[np.int8]
    masks: Ints32
    named: Ints
    counts: dict[str, dict[str, int]]

    def first(self, level: int) -> int:
        """Number of the first thing of a level."""
        return int((self.level < level).sum())

    def label(self, frame: int, labels: Ints32) -> Ints32:
        """(L, H, W) int32 thing of each pixel of a frame at each level, -1 for none, from its ``labels`` in segments.zarr."""
        geometry, size = self.geometry, labels.shape[1:]
        view = geometry.views.camera, geometry.camera_to_world[frame], geometry.settings
        found = render_things(geometry.gaussians, self.beliefs, *view, (size[0], size[1]))
        firsts = np.array([self.first(level) for level in range(len(found))], np.int32)
        rendered = np.where(found >= 0, found + firsts[:, None, None], np.int32(-1))
        things = keep_outlines(rendered, draw_masks(self.named, frame, labels))
        return np.where(self.shown(frame), things, np.int32(-1))

    def strongest(self) -> Ints32:
        """(N, L) int32 thing that each Gaussian belongs to most at each level, -1 for none."""
        best = [first_of_largest(held) for held in self.beliefs]
        numbers = [np.where(own >= 0, own + self.first(level), -1) for level, own in enumerate(best)]
        return np.stack(numbers, axis=1).astype(np.int32)


def draw_masks(named: Ints, frame: int, labels: Ints32) -> Ints32:
    """(L, H, W) thing that each pixel's mask shows in a frame, -1 for none, from its labels in segments.zarr.
    ``named``: as in ``Scene``."""
    _, instance, thing = named[:, named[0] == frame]
    # Label -1 indexes the last entry.
    table = np.full(int(max(labels.max(initial=-1), instance.max(initial=-1))) + 2, -1, np.int32)
    table[instance] = thing
    return table[labels]


def keep_outlines(rendered: Ints32, drawn: Ints32) -> Ints32:
    """Draw (L, H, W) masks over the rendered things of a frame. Where a thing has a mask, its rendering counts nowhere."""
    # Thing -1 indexes the last entry.
    has_mask = np.zeros(int(max(rendered.max(initial=-1), drawn.max(initial=-1))) + 2, bool)
    has_mask[drawn] = True
    has_mask[-1] = False
    return np.where(drawn >= 0, drawn, np.where(has_mask[rendered], np.int32(-1), rendered))


def first_of_largest(values: sparse.csr_array) -> Ints:
    """(N,) column of the largest value of each row of (N, K) values, the first of equal ones; -1 if none is above 0."""
    # SciPy's own argmax visits row by row in Python.
    rows = np.repeat(np.arange(len(values.indptr) - 1), np.diff(values.indptr))
    above = values.data > 0
    rows, columns, data = rows[above], values.indices[above], np.asarray(values.data)[above]
    order = np.lexsort((columns, np.negative(data), rows))
    owner, first = np.unique(rows[order], return_index=True)
    found = np.full(len(values.indptr) - 1, -1, np.int64)
    found[owner] = columns[order][first]
    return found


def find_scene(
    geometry: Geometry, segments: Artifact, shown: Callable[[int], Bools], tracks: MovingTracks
) -> Scene:
    """Find the things of all levels. Pixels of ``tracks``, of what moves, neither vote nor count as seen
    (UserError: no view has a mask)."""
    lifted = lift(geometry, segments, shown, tracks.remove)
    if lifted is None:
        raise UserError(
            f"{segments.path}: holds no mask in a training frame with a pose. Set models.set to models that suit the "
            "recording (docs/models.md), or instances.source to tracks"
        )
    levels = segments.read("instances/level")
    held, level, masks, named, counts = [], [], [], [], {}
    for number, name in enumerate(segments.facts["levels"]):
        some = lifted.select(levels[lifted.instance] == number)
        thing, counts[name] = find_things(some, lifted.weight)
        log(
            f"{counts[name]['things']} {name}s from {counts[name]['masks']} masks; {counts[name]['dropped']} masks and "
            f"{counts[name]['claimed']} {name}s are left out, because others contradict them"
        )
        count, first = counts[name]["things"], sum(len(own) for own in level)
        held.append(beliefs(some, thing))
        level.append(np.full(count, number, np.int8))
        masks.append(np.bincount(thing[thing >= 0], minlength=count).astype(np.int32))
        named.append([lifted.row[some.frame], some.instance, np.where(thing >= 0, thing + first, -1)])
    level, masks, named = np.concatenate(level), np.concatenate(masks), np.concatenate(named, axis=1)
    return Scene(geometry, shown, held, level, masks, named, counts)
