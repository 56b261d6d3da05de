"""The lenses and masks of a plain recording's pictures, from ``camera.json`` or from known poses."""

import os
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from egosplat.calibration.files import CAMERA_FILE, companion_path, known_poses_path
from egosplat.calibration.known_poses import check_numbers, match_pictures, read_known_poses, unmatched_line
from egosplat.calibration.lens import Lens, Rectifier, read_camera_file, shared_pinhole
from egosplat.errors import UserError
from egosplat.frames.images import ImageFolder
from egosplat.frames.video import Video
from egosplat.geometry import Camera
from egosplat.progress import log


@dataclass(frozen=True)
class Lenses:
    """The lenses of a source's pictures, and their masks.

    Attributes:
        lenses: none, one for all pictures, or several.
        lens_of: the index of each picture's lens; empty for one lens.
        masks: the mask of each picture, or None; empty if there is none.
    """

    lenses: list[Lens] = field(default_factory=list)
    lens_of: list[int] = field(default_factory=list)
    masks: list[Path | None] = field(default_factory=list)

    @cached_property
    def pinhole(self) -> Camera | None:
        """The camera of the rectified pictures; None without a lens."""
        pictures = np.bincount(self.lens_of, minlength=len(self.lenses)).tolist() if self.lens_of else [1]
        return shared_pinhole(self.lenses, pictures) if self.lenses else None

    def index(self, frame: int) -> int:
        return self.lens_of[frame] if self.lens_of else 0

    def mask(self, frame: int) -> Path | None:
        return self.masks[frame] if self.masks else None

    def rectifier(self, frame: int) -> Rectifier | None:
        """What rectifies a picture; None without a lens."""
        return _rectifier(self.lenses[self.index(frame)], self.pinhole) if self.lenses else None


@lru_cache(maxsize=4)
def _rectifier(lens: Lens, target: Camera) -> Rectifier:
    # A phone's pictures may have a lens each, and a table of positions takes megabytes.
    return Rectifier(lens, target)


def calibrate(path: Path, kind: str | None, source: Video | ImageFolder) -> Lenses:
    """The lenses of full-size pictures: of the known poses, or of ``camera.json``; none without either."""
    file = companion_path(path, CAMERA_FILE)
    # A broken link is not a missing file: reading it reports the error.
    calibrated = os.path.lexists(file)
    if kind is None:
        return Lenses([read_camera_file(file, source.width, source.height)] if calibrated else [])
    known = known_poses_path(path, kind)
    if calibrated:
        raise UserError(f"{file}: {known} has a camera, too. Remove one, or set frames.known_poses=none.")
    contents = read_known_poses(path, kind, source.width, source.height)
    several = len(contents.lenses) > 1
    if isinstance(source, Video):
        check_numbers(contents.names, len(source.timestamp_ns), known)
    row, unmatched = match_pictures(contents.names, source.names, known)
    if contents.unread:
        log(f"{known}: these keys do not count: {', '.join(contents.unread)}")
    if unmatched:
        log(unmatched_line(unmatched, known))
    if several:
        log(f"{known}: {len(contents.lenses)} cameras; the frames show what all of them see")
        row = _only_matched(row, source)
    masks = [contents.masks[index] if index >= 0 else None for index in row] if contents.masks else []
    lenses = Lenses(contents.lenses, contents.lens_of[row].tolist() if several else [], masks)
    if source.oriented:
        # COLMAP reads pictures as they are stored; they are turned only if this is their camera's size.
        if _misfit(lenses, source) is not None:
            source.turn()
        how = "turned by it, as the size of their camera asks"
        how = how if source.turned else "as stored, as COLMAP reads them"
        log(
            f"{path.name}: {source.oriented} pictures of {known} have an EXIF orientation: they are read {how}"
        )
    if (frame := _misfit(lenses, source)) is not None:
        lens, (width, height) = lenses.lenses[lenses.index(frame)], source.sizes[frame]
        raise UserError(
            f"{known}: for {lens.width}x{lens.height} px, but the frames are {width}x{height} "
            f"({source.names[frame]})."
        )
    return lenses


def _only_matched(row: np.ndarray, source: Video | ImageFolder) -> np.ndarray:
    """The rows of the pictures whose camera is known, where there are several cameras; the source keeps no other."""
    matched = np.flatnonzero(row >= 0)
    if len(matched) < len(row):
        if isinstance(source, Video):
            raise UserError(f"{source.path}: a video has one camera, but its known poses have several.")
        log(f"{source.path}: leaves out {len(row) - len(matched)} pictures whose camera is not known")
        source.keep(matched)
    return row[matched]


def _misfit(lenses: Lenses, source: Video | ImageFolder) -> int | None:
    """The first picture that has not the size of its camera."""
    sizes = [(lens.width, lens.height) for lens in lenses.lenses]
    return next((at for at, size in enumerate(source.sizes) if size != sizes[lenses.index(at)]), None)
