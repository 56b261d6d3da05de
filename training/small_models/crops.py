"""Crops of rendered worlds, each with its mask, names and looks.

A crop is a square patch around the mask's bounding box with a margin, so that masks can be grown, shrunk and
covered during training. It keeps the background, so a crop can be shown masked or as an unmasked square.
The mask of a tile is all of its square; that of a segment is the convex hull of a mask that SAM2 found.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.features.crops import fill_hull
from egosplat.files import atomic_file
from training.small_models.attributes import Appearance, find_appearance
from training.small_models.levels import LEVELS, Levels
from training.small_models.patches import cut_patch, cut_tile, draw_side
from training.small_models.worlds import RenderedWorld, read_world, rebuild_world

_FRAME_STEP = 2
_LEAST_PX = {"subpart": 60, "part": 45, "whole": 40}
# Fraction of the crops to keep, by level; ``_LEAST_PX`` is the smallest mask.
_KEPT = {"subpart": 0.15, "part": 0.5, "whole": 1.0}
# Fraction of the building's wholes to keep, because they are in every image.
_KEPT_OF_BUILDING = 0.4

# A crop shows a subpart, part or whole with its mask; or is a tile; or shows a mask of SAM2.
KINDS = ("object", "tile", "segment")
# A mask of SAM2 shows the subpart, part or whole that it covers best, from this IoU on.
_LEAST_IOU = 0.25
# Tiles to cut around random pixels of each visible whole in an image.
_TILES_PER_WHOLE = 4

# Name of the wearer, of whom only the arms are visible.
OWN_ARMS = "own arms"


@dataclass(frozen=True, eq=False)
class Crops:
    """N crops.

    Attributes:
        patches: (N, PATCH_PX, PATCH_PX, 4) uint8: red, green, blue, and the mask, 255 inside.
        kind: (N,) index into ``KINDS``. The following describe the whole that fills most of a tile, and what a segment
            covers best.
        names: (N,) category or building piece, and for a part a slash and its name.
        level: (N,) index into ``LEVELS``.
        colors: (N, len(COLORS)) float32 fractions of its surface.
        surfaces: (N,) fractions of its materials: "striped cloth:0.75,wood:0.25".
        area: (N,) its pixels in the crop; side: (N,) side of the mask's bounding square [px].
        share: (N,) fraction of its whole's visible pixels.
        world, whole, frame: (N,) seed, number of the whole in that world, number of the image.
    """

    patches: NDArray[np.uint8]
    kind: NDArray[np.int32]
    names: NDArray[np.str_]
    level: NDArray[np.int32]
    colors: NDArray[np.float32]
    surfaces: NDArray[np.str_]
    area: NDArray[np.int32]
    side: NDArray[np.int32]
    share: NDArray[np.float32]
    world: NDArray[np.int32]
    whole: NDArray[np.int32]
    frame: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.names)

    def chosen(self, which: NDArray) -> "Crops":
        """The crops that a mask or a list of indices selects."""
        return Crops(*(getattr(self, one.name)[which] for one in fields(Crops)))


# (N, H, W, 3) images -> the (L, H, W) int32 masks of each, -1 for none.
Segmenter = Callable[[NDArray[np.uint8]], Iterator[NDArray[np.int32]]]


def cut_world(folder: Path, output: Path, segment: Segmenter | None = None) -> None:
    """Cut the crops of a rendered world into a file; ``segment`` finds masks to cut, too."""
    rendered = read_world(folder)
    world, levels = rebuild_world(folder)
    wholes = list(rendered.names)
    for whole, instance in enumerate(levels.whole_instance):
        if world.instances[instance].name == "Skeleton_W":
            wholes[whole] = OWN_ARMS
    table = _Table(rendered, levels, wholes, find_appearance(world.geometry))
    segments = None
    if segment is not None:
        segments = segment(rendered.rgb[:, ::_FRAME_STEP].reshape(-1, *rendered.rgb.shape[2:]))
    crops = cut_crops(table, world.seed, segments)
    with atomic_file(output) as made, made.open("wb") as file:
        np.savez(file, **{one.name: getattr(crops, one.name) for one in fields(Crops)})


def read_crops(files: Sequence[Path]) -> Crops:
    """Read and concatenate the crops of several files."""
    read = [np.load(file) for file in files]
    return Crops(*(np.concatenate([one[field.name] for one in read]) for field in fields(Crops)))


def plain_name(part: str) -> str:
    """The name of a part without number and side: ``left hand`` -> ``hand``, ``wall 2`` -> ``wall``."""
    words = [word for word in part.split() if not word.isdigit() and word not in ("left", "right")]
    return " ".join(words)


class _Table:
    """Names and looks of the subparts, parts and wholes of a rendered world."""

    def __init__(
        self, rendered: RenderedWorld, levels: Levels, wholes: Sequence[str], appearance: Appearance
    ) -> None:
        self.rendered = rendered
        self.levels = levels
        self.wholes = [plain_name(name) for name in wholes]
        self.building = levels.whole_instance == 0
        self.appearance = appearance
        used = rendered.subpart[:, ::_FRAME_STEP]
        counts = np.bincount(rendered.labels(used)[1].ravel() + 1, minlength=len(levels.part_names) + 1)
        self.part_px = counts[1:]
        # A subpart or part that is all of its parent would be cut twice.
        self._alone = {
            "subpart": np.bincount(levels.subpart_part)[levels.subpart_part] == 1,
            "part": np.bincount(levels.part_whole)[levels.part_whole] == 1,
            "whole": np.zeros(len(wholes), dtype=bool),
        }

    def name(self, level: str, number: int) -> str:
        """Name of a subpart, part or whole."""
        if level == "whole":
            return self.wholes[number]
        part = self._part(level, number)
        return f"{self.wholes[self.levels.part_whole[part]]}/{plain_name(self.levels.part_names[part])}"

    def looks(self, level: str, number: int) -> tuple[NDArray[np.float32], str]:
        """Fractions of colors and of surfaces, over all its visible pixels in the world's images."""
        if level == "whole":
            parts = np.flatnonzero(self.levels.part_whole == number)
        else:
            parts = np.array([self._part(level, number)])
        # Visible pixels, not areas of the model: the inside of a drawer has no color in the images.
        weight = self.part_px[parts] / self.part_px[parts].sum()
        surfaces: dict[str, float] = {}
        for part, share in zip(parts, weight, strict=True):
            name = self.appearance.surfaces[part]
            surfaces[name] = surfaces.get(name, 0.0) + float(share)
        listed = ",".join(f"{name}:{share:.2f}" for name, share in surfaces.items() if name and share > 0.005)
        return weight @ self.appearance.colors[parts], listed

    def _part(self, level: str, number: int) -> int:
        return int(self.levels.subpart_part[number]) if level == "subpart" else number

    def whole_of(self, level: str, number: int) -> int:
        """Number of the whole that a subpart, part or whole belongs to."""
        return number if level == "whole" else int(self.levels.part_whole[self._part(level, number)])

    def described(self, level: str, number: int, area: int, whole_px: NDArray[np.int64]) -> dict[str, object]:
        """Fields of a crop of a subpart, part or whole with an area [px]; whole_px: visible pixels of wholes."""
        whole = self.whole_of(level, number)
        colors, surfaces = self.looks(level, number)
        return {
            "names": self.name(level, number),
            "level": LEVELS.index(level),
            "colors": colors,
            "surfaces": surfaces,
            "share": area / whole_px[whole],
            "whole": whole,
        }

    def share_kept(self, level: str, number: int) -> float:
        """Fraction of its crops to keep."""
        if self._alone[level][number]:
            return 0.0
        return _KEPT[level] * (_KEPT_OF_BUILDING if self.building[self.whole_of(level, number)] else 1.0)


def cut_crops(table: _Table, seed: int, segments: Iterator[NDArray[np.int32]] | None = None) -> Crops:
    """Cut the crops of every second image of a world.

    Args:
        segments: (L, H, W) masks found in each of these images, -1 for none; None to cut none of them.
    """
    # Generators of their own, so that tiles do not change which objects are cut.
    objects_rng, tiles_rng = np.random.default_rng([seed, 101]), np.random.default_rng([seed, 102])
    rows: list[dict[str, object]] = []
    clips, frames = table.rendered.subpart.shape[:2]
    for clip in range(clips):
        for frame in range(0, frames, _FRAME_STEP):
            rgb = np.asarray(table.rendered.rgb[clip, frame])
            labels = table.rendered.labels(table.rendered.subpart[clip, frame])
            px = [np.bincount(image.ravel() + 1)[1:] for image in labels]
            cut = [*_objects(table, rgb, labels, px, objects_rng)]
            cut += _tiles(table, rgb, labels[2], px[2], tiles_rng)
            cut += _segments(table, rgb, labels, px, next(segments)) if segments else []
            rows += [row | {"world": seed, "frame": clip * frames + frame} for row in cut]
    kinds = {
        "patches": np.uint8,
        "names": np.str_,
        "surfaces": np.str_,
        "colors": np.float32,
        "share": np.float32,
    }
    return Crops(
        *(
            np.array([row[one.name] for row in rows], dtype=kinds.get(one.name, np.int32))
            for one in fields(Crops)
        )
    )


def _objects(
    table: _Table,
    rgb: NDArray[np.uint8],
    labels: NDArray[np.int32],
    px: Sequence[NDArray[np.int64]],
    rng: np.random.Generator,
) -> Iterator[dict[str, object]]:
    """Crops of the subparts, parts and wholes of an image; labels are (3, H, W), px the pixels of each, by level."""
    for level, image, counts in zip(LEVELS, labels, px, strict=True):
        for number in np.flatnonzero(counts >= _LEAST_PX[level]):
            if rng.random() < table.share_kept(level, number):
                patch, side = cut_patch(rgb, image == number)
                row = {"patches": patch, "kind": KINDS.index("object"), "area": counts[number], "side": side}
                yield row | table.described(level, number, counts[number], px[2])


def _tiles(
    table: _Table,
    rgb: NDArray[np.uint8],
    wholes: NDArray[np.int32],
    whole_px: NDArray[np.int64],
    rng: np.random.Generator,
) -> Iterator[dict[str, object]]:
    """Tiles around random pixels of the wholes of an image, if it is clear what they show; wholes are (H, W)."""
    for number in np.repeat(np.flatnonzero(whole_px >= _LEAST_PX["whole"]), _TILES_PER_WHOLE):
        middle = rng.choice(np.flatnonzero(wholes == number))
        side = draw_side(len(wholes), rng)
        tile = cut_tile(rgb, wholes, *np.unravel_index(middle, wholes.shape), side)
        if tile and rng.random() < table.share_kept("whole", tile[1]):
            patch, shown, area = tile
            row = {"patches": patch, "kind": KINDS.index("tile"), "area": area, "side": side}
            yield row | table.described("whole", shown, area, whole_px)


def _segments(
    table: _Table,
    rgb: NDArray[np.uint8],
    labels: NDArray[np.int32],
    px: Sequence[NDArray[np.int64]],
    masks: NDArray[np.int32],
) -> Iterator[dict[str, object]]:
    """Crops of the masks of an image, by their convex hulls; labels and px as in ``_objects``, masks (L, H, W), -1 for none."""
    for image in masks:
        for number in np.unique(image[image >= 0]):
            mask = image == number
            level, shown, iou = _most_alike(table, labels, px, mask)
            if iou >= _LEAST_IOU:
                patch, side = cut_patch(rgb, fill_hull(mask))
                row = {"patches": patch, "kind": KINDS.index("segment"), "area": mask.sum(), "side": side}
                yield row | table.described(level, shown, int(px[LEVELS.index(level)][shown]), px[2])


def _most_alike(
    table: _Table, labels: NDArray[np.int32], px: Sequence[NDArray[np.int64]], mask: NDArray[np.bool_]
) -> tuple[str, int, float]:
    """The level and number of what a mask covers best, and the IoU; of equal ones the whole."""
    found, area = ("whole", -1, 0.0), mask.sum()
    for level, image, counts in reversed(list(zip(LEVELS, labels, px, strict=True))):
        shared = np.bincount(image[mask] + 1)[1:]
        for number in np.flatnonzero(shared):
            iou = shared[number] / (area + counts[number] - shared[number])
            if iou > found[2] and table.share_kept(level, number) > 0:
                found = (level, int(number), float(iou))
    return found


def sampling_weights(names: np.ndarray, kind: np.ndarray, tiles: float, segments: float = 0.0) -> np.ndarray:
    """(N,) sampling weight of each crop, higher for rare names; all sum to 1.

    Args:
        names, kind: (N,), as in ``Crops``.
        tiles, segments: sums of the weights of tiles and segments.
    """
    tile, part = kind == KINDS.index("tile"), np.char.find(names, "/") >= 0
    weight = np.zeros(len(names))
    for masked, share in (("object", 1 - tiles - segments), ("segment", segments)):
        own = kind == KINDS.index(masked)
        # Most queries are about wholes.
        for which, fraction in ((own & ~part, 1.2 / 2.2), (own & part, 1 / 2.2)):
            weight[which] = share * fraction * _rarity(names[which])
    weight[tile] = tiles * _rarity(names[tile])
    return weight


def _rarity(names: np.ndarray) -> np.ndarray:
    """(N,) weights of names, higher for rare ones, which sum to 1."""
    _, number, count = np.unique(names, return_inverse=True, return_counts=True)
    rare = count[number] ** -0.6
    return rare / rare.sum() if len(rare) else rare
