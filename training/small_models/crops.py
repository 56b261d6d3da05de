"""Crops of rendered worlds, each with its mask, names and looks.

A crop is a square patch around the mask's bounding box with a margin, so that masks can be grown, shrunk and
covered during training.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.files import atomic_file
from training.small_models.attributes import Appearance, find_appearance
from training.small_models.levels import LEVELS, Levels
from training.small_models.worlds import RenderedWorld, read_world, rebuild_world

# Side of a stored patch, and of the mask's bounding square in it.
PATCH_PX, INNER_PX = 72, 64

_FRAME_STEP = 2
_LEAST_PX = {"subpart": 60, "part": 45, "whole": 40}
# Fraction of the crops to keep, by level; ``_LEAST_PX`` is the smallest mask.
_KEPT = {"subpart": 0.15, "part": 0.5, "whole": 1.0}
# Fraction of the building's wholes to keep, because they are in every image.
_KEPT_OF_BUILDING = 0.4

# Name of the wearer, of whom only the arms are visible.
OWN_ARMS = "own arms"


@dataclass(frozen=True, eq=False)
class Crops:
    """N crops.

    Attributes:
        patches: (N, PATCH_PX, PATCH_PX, 4) uint8: red, green, blue, and the mask, 255 inside.
        names: (N,) category or building piece, and for a part a slash and its name.
        level: (N,) index into ``LEVELS``.
        colours: (N, len(COLOURS)) float32 fractions of its surface.
        surfaces: (N,) fractions of its materials: "striped cloth:0.75,wood:0.25".
        area: (N,) pixels of its mask in the image; side: (N,) side of its bounding square [px].
        share: (N,) fraction of its whole's visible pixels.
        world, whole, frame: (N,) seed, number of the whole in that world, number of the image.
    """

    patches: NDArray[np.uint8]
    names: NDArray[np.str_]
    level: NDArray[np.int32]
    colours: NDArray[np.float32]
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


def cut_world(folder: Path, output: Path) -> None:
    """Cut the crops of a rendered world into a file."""
    rendered = read_world(folder)
    world, levels = rebuild_world(folder)
    wholes = list(rendered.names)
    for whole, instance in enumerate(levels.whole_instance):
        if world.instances[instance].name == "Skeleton_W":
            wholes[whole] = OWN_ARMS
    table = _Table(rendered, levels, wholes, find_appearance(world.geometry))
    crops = cut_crops(table, world.seed, np.random.default_rng([world.seed, 101]))
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
        """Fractions of colours and of surfaces, over all its visible pixels in the world's images."""
        if level == "whole":
            parts = np.flatnonzero(self.levels.part_whole == number)
        else:
            parts = np.array([self._part(level, number)])
        # Visible pixels, not areas of the model: the inside of a drawer has no colour in the images.
        weight = self.part_px[parts] / self.part_px[parts].sum()
        surfaces: dict[str, float] = {}
        for part, share in zip(parts, weight, strict=True):
            name = self.appearance.surfaces[part]
            surfaces[name] = surfaces.get(name, 0.0) + float(share)
        listed = ",".join(f"{name}:{share:.2f}" for name, share in surfaces.items() if name and share > 0.005)
        return weight @ self.appearance.colours[parts], listed

    def _part(self, level: str, number: int) -> int:
        return int(self.levels.subpart_part[number]) if level == "subpart" else number

    def whole_of(self, level: str, number: int) -> int:
        """Number of the whole that a subpart, part or whole belongs to."""
        return number if level == "whole" else int(self.levels.part_whole[self._part(level, number)])

    def share_kept(self, level: str, number: int) -> float:
        """Fraction of its crops to keep."""
        if self._alone[level][number]:
            return 0.0
        return _KEPT[level] * (_KEPT_OF_BUILDING if self.building[self.whole_of(level, number)] else 1.0)


def cut_crops(table: _Table, seed: int, rng: np.random.Generator) -> Crops:
    """Cut the crops of every second image of a world."""
    columns: dict[str, list] = {one.name: [] for one in fields(Crops)}
    clips, frames = table.rendered.subpart.shape[:2]
    for clip in range(clips):
        for frame in range(0, frames, _FRAME_STEP):
            rgb = np.asarray(table.rendered.rgb[clip, frame])
            labels = table.rendered.labels(table.rendered.subpart[clip, frame])
            whole_px = np.bincount(labels[2].ravel() + 1)[1:]
            for level, image in zip(LEVELS, labels, strict=True):
                counts = np.bincount(image.ravel() + 1)[1:]
                for number in np.flatnonzero(counts >= _LEAST_PX[level]):
                    if rng.random() >= table.share_kept(level, number):
                        continue
                    whole = table.whole_of(level, number)
                    patch, side = cut_patch(rgb, image == number)
                    colours, surfaces = table.looks(level, number)
                    row = {
                        "patches": patch,
                        "names": table.name(level, number),
                        "level": LEVELS.index(level),
                        "colours": colours,
                        "surfaces": surfaces,
                        "area": counts[number],
                        "side": side,
                        "share": counts[number] / whole_px[whole],
                        "world": seed,
                        "whole": whole,
                        "frame": clip * frames + frame,
                    }
                    for name, value in row.items():
                        columns[name].append(value)
    kinds = {
        "patches": np.uint8,
        "names": np.str_,
        "surfaces": np.str_,
        "colours": np.float32,
        "share": np.float32,
    }
    return Crops(*(np.array(column, dtype=kinds.get(name, np.int32)) for name, column in columns.items()))


def cut_patch(rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], int]:
    """A (PATCH_PX, PATCH_PX, 4) patch of an image around a mask, and the side of its bounding square [px].

    Args:
        rgb: (H, W, 3); mask: (H, W), not empty. Outside the image both count as 0.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    side = max(bottom - top, right - left)
    # A margin in whole pixels, at least one.
    margin = max(1, round(side * (PATCH_PX - INNER_PX) / 2 / INNER_PX))
    width = side + 2 * margin
    y0, x0 = (top + bottom - width) // 2, (left + right - width) // 2
    square = np.zeros((width, width, 4), dtype=np.uint8)
    y, x = (
        slice(max(0, y0), min(mask.shape[0], y0 + width)),
        slice(max(0, x0), min(mask.shape[1], x0 + width)),
    )
    inside = square[y.start - y0 : y.stop - y0, x.start - x0 : x.stop - x0]
    inside[..., :3], inside[..., 3] = rgb[y, x], 255 * mask[y, x]
    way = cv2.INTER_AREA if width > PATCH_PX else cv2.INTER_LINEAR
    return cv2.resize(square, (PATCH_PX, PATCH_PX), interpolation=way), int(side)
