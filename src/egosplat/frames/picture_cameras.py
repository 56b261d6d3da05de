"""The cameras and masks of a plain recording's pictures, from ``camera.json`` or from known poses."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from egosplat.calibration.companions import companion_path, known_poses_path
from egosplat.calibration.contents import Contents
from egosplat.calibration.known_poses import (
    Match,
    check_numbers,
    match_pictures,
    read_known_poses,
    unmatched_line,
)
from egosplat.calibration.lens import Lens, Rectifier, read_camera_file, shared_pinhole
from egosplat.errors import UserError
from egosplat.frames.files import CAMERA_FILE
from egosplat.frames.images import ImageFolder
from egosplat.frames.video import Video
from egosplat.geometry import Camera
from egosplat.progress import log


@dataclass(frozen=True)
class Calibration:
    """The lenses of a source's pictures, and their masks.

    Attributes:
        lenses: none, one for all pictures, or several.
        lens_of: the index of each picture's lens; empty for one lens.
        masks: the mask of each picture, or None; empty if there is none.
    """

    lenses: list[Lens]
    lens_of: list[int] = field(default_factory=list)
    masks: list[Path | None] = field(default_factory=list)

    @cached_property
    def pinhole(self) -> Camera | None:
        """The camera of the rectified pictures; None without a lens."""
        pictures = np.bincount(self.lens_of, minlength=len(self.lenses)).tolist() if self.lens_of else [1]
        return shared_pinhole(self.lenses, pictures) if self.lenses else None

    def lens_index(self, frame: int) -> int:
        return self.lens_of[frame] if self.lens_of else 0

    def mask(self, frame: int) -> Path | None:
        return self.masks[frame] if self.masks else None

    def rectifier(self, frame: int) -> Rectifier | None:
        """What rectifies a picture; None without a lens."""
        return _rectifier(self.lenses[self.lens_index(frame)], self.pinhole) if self.lenses else None


@lru_cache(maxsize=4)
def _rectifier(lens: Lens, target: Camera) -> Rectifier:
    # A phone's pictures may have a lens each, and a table of positions takes megabytes.
    return Rectifier(lens, target)


def calibrate(path: Path, kind: str | None, source: Video | ImageFolder) -> Calibration:
    """The calibration of full-size pictures: of the known poses, or of ``camera.json``; without lenses without either."""
    file = companion_path(path, CAMERA_FILE)
    # A broken link is not a missing file: reading it reports the error.
    calibrated = os.path.lexists(file)
    if kind is None:
        return Calibration([read_camera_file(file, source.width, source.height)] if calibrated else [])
    known = known_poses_path(path, kind)
    if calibrated:
        raise UserError(f"{file}: {known} has a camera, too. Remove one, or set frames.known_poses=none.")
    contents = read_known_poses(path, kind, source.width, source.height)
    if isinstance(source, Video):
        check_numbers(contents.names, len(source.timestamp_ns), known)
    match = match_pictures(contents.names, source.names, known)
    _log_known(known, contents, match)
    if len(contents.lenses) > 1:
        match = _only_matched(match, source)
    lens_of = contents.lens_of[match.row].tolist() if len(contents.lenses) > 1 else []
    masks = [contents.masks[row] if row >= 0 else None for row in match.row] if contents.masks else []
    calibration = Calibration(contents.lenses, lens_of, masks)
    _settle_orientation(calibration, source, path, known)
    _check_sizes(calibration, source, contents.camera_file)
    return calibration


def _only_matched(match: Match, source: Video | ImageFolder) -> Match:
    """The pictures whose camera is known, where there are several cameras; the source keeps no other."""
    matched = np.flatnonzero(match.row >= 0)
    if len(matched) < len(match.row):
        if isinstance(source, Video):
            raise UserError(f"{source.path}: a video has one camera, but its known poses have several.")
        log(f"{source.path}: leaves out {len(match.row) - len(matched)} pictures whose camera is not known")
        source.keep(matched)
    return Match(match.row[matched], match.unmatched)


def _settle_orientation(
    calibration: Calibration, source: Video | ImageFolder, path: Path, known: Path
) -> None:
    """Read pictures with an EXIF orientation as COLMAP does, as they are stored; turned if only this is their camera's size."""
    if not source.oriented:
        return
    if any(_misfits(calibration, source)):
        source.turn()
    how = (
        "turned by it, as the size of their camera asks"
        if source.turned
        else "as stored, as COLMAP reads them"
    )
    log(f"{path.name}: {source.oriented} pictures of {known} have an EXIF orientation: they are read {how}")


def _misfits(
    calibration: Calibration, source: Video | ImageFolder
) -> Iterator[tuple[str, tuple[int, int], Lens]]:
    """Yield name, size and lens of the pictures that have not the size of their camera."""
    for frame, name in enumerate(source.names):
        size, lens = source.sizes[frame], calibration.lenses[calibration.lens_index(frame)]
        if size != (lens.width, lens.height):
            yield name, size, lens


def _check_sizes(calibration: Calibration, source: Video | ImageFolder, camera_file: str) -> None:
    """Raise UserError unless each picture has the size of its camera."""
    for name, (width, height), lens in _misfits(calibration, source):
        raise UserError(
            f"{camera_file}: for {lens.width}x{lens.height} px, but the frames are {width}x{height} ({name})."
        )


def _log_known(known: Path, contents: Contents, match: Match) -> None:
    """Say what of the known poses does not count."""
    if contents.unread:
        log(f"{known}: these keys do not count: {', '.join(contents.unread)}")
    if line := unmatched_line(match, known):
        log(line)
    if (count := len(contents.lenses)) > 1:
        log(f"{known}: {count} cameras; the frames show what all of them see")
