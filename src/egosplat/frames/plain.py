"""Read plain recordings: any video file or folder of images, with the companion files of docs/recordings.md."""

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.colmap.distortion import lens_of_frames
from egosplat.calibration.companions import AUTO, KNOWN_POSES, companion_path
from egosplat.calibration.contents import Contents
from egosplat.calibration.known_poses import (
    Match,
    check_numbers,
    find_known_poses,
    match_pictures,
    read_known_poses,
    unmatched_line,
)
from egosplat.calibration.lens import Lens, Rectifier, read_camera_file, shared_pinhole
from egosplat.errors import UserError
from egosplat.frames.files import CAMERA_FILE, VALID_MASK
from egosplat.frames.images import ImageFolder, read_mask, read_valid
from egosplat.frames.keys import ReaderKeys
from egosplat.frames.recording import Capture
from egosplat.frames.selection import FIRST, SHARPEST, select_frames, select_sharpest
from egosplat.frames.video import Video, open_source
from egosplat.geometry import Camera
from egosplat.images import measure_sharpness, resize_image, resize_mask, shrunk_size
from egosplat.progress import log, track

# Guessed focal length in units of the longer side: COLMAP's default, a field of view of 45°.
FOCAL_PRIOR = 1.2

# Frames per second that show a walk well enough. COLMAP takes six times as long for three times as many (docs/speed.md).
ENOUGH_PER_S = 3.0


def open_recording(path: Path, keys: ReaderKeys) -> "PlainRecording":
    """Open a video or a folder of images; see ``PlainRecording``."""
    return PlainRecording(
        path, known_poses=keys.known_poses, lens=keys.lens, pick=keys.pick, **keys.selection
    )


class PlainRecording:
    """A video or a folder of images; a ``Recording`` without a device frame."""

    def __init__(
        self,
        path: Path,
        *,
        resolution: int,
        stride: int,
        start_s: float,
        end_s: float | None,
        known_poses: str = AUTO,
        lens: str = "auto",
        pick: str = FIRST,
    ) -> None:
        """Open the source, select frames and find the camera.

        Args:
            path: video file or image folder.
            resolution: longer side of the frames [px]; a smaller source keeps its own.
            stride, start_s, end_s: see ``selection.select_frames``; a folder has one image per second.
            known_poses: see ``known_poses.find_known_poses``.
            lens: see ``distortion.lens_of_frames``; a calibration takes its place.
            pick: ``first`` or ``sharpest`` of every ``stride`` frames.

        Raises:
            UserError: the source or the calibration cannot be read, or an option is out of range.
        """
        kind = find_known_poses(path, known_poses)
        self._source = open_source(path, kind)
        self._calibration = _calibrate(path, kind, self._source)
        full = self._calibration.pinhole or _guess_camera(self._source.width, self._source.height)
        width, height = fit(full, resolution, path)
        times, pictures = self._source.timestamp_ns, picture_names(self._source)
        self._valid = _read_valid(path, self._source)
        # At full size, so that a reduced pixel is valid only if all its pixels are.
        reduced = resize_mask(self._valid, width, height)
        interval = {"start_s": start_s, "end_s": end_s, "source": path}
        self._frames = select_frames(times, stride=stride, **interval)
        if pick == SHARPEST and stride > 1:
            every = select_frames(times, stride=1, **interval)
            self._frames = select_sharpest(every, self._sharpness(every, reduced), stride)
        if kind is None and (line := stride_advice(times[self._frames], stride)):
            log(f"{path.name}: {line}")
        self.capture = Capture.of_video(times[self._frames], full.scaled_to(width, height), False, reduced)
        evidence = None
        if not self._calibration.lenses:
            estimated, evidence = lens_of_frames(
                lens, self.read_frames, len(self._frames), reduced, self.capture.camera
            )
            self._calibration = _Calibration([estimated.scaled_to(full.width, full.height)] if estimated else [])
        self._finish(kind is not None or evidence is None and bool(self._calibration.lenses))
        of_frame = [self._calibration.lens_index(frame) for frame in self._frames.tolist()]
        facts = {
            "pictures": [pictures[frame] for frame in self._frames],
            "known_poses": kind,
            "pinhole": asdict(pinhole) if (pinhole := self._calibration.pinhole) else None,
            "lenses": [asdict(one) for one in self._calibration.lenses],
            "lens_of_frame": of_frame,
            "lens_evidence": evidence,
        }
        self.capture = replace(self.capture, facts=facts)

    def _sharpness(self, frames: NDArray[np.int64], valid: NDArray[np.bool_]) -> Iterator[float]:
        """Yield the sharpness of frames of the source, reduced to the size of a mask."""
        for full in track(self._source.read_frames(frames), "looking for sharp frames", total=len(frames)):
            yield measure_sharpness(resize_image(full, *valid.shape[::-1]), valid)

    def _finish(self, known: bool) -> None:
        """Set the camera of the rectified frames, the pixels that show the scene, and those that single frames leave out."""
        width, height = self.capture.camera.width, self.capture.camera.height
        if pinhole := self._calibration.pinhole:
            self.capture = replace(
                self.capture, camera=pinhole.scaled_to(width, height), camera_known=known
            )
        count = len(self._frames)
        if not any(self._is_masked(index) for index in range(count)):
            self.capture = replace(self.capture, valid=self._shown(0))
            return
        frames = track(range(count), "reading masks", total=count)
        shown = np.stack([np.packbits(self._shown(index), axis=1) for index in frames])
        # What no frame shows is the picture's own border; the rest are pixels of single frames.
        valid = np.bitwise_or.reduce(shown)
        left_out = valid & ~shown

        def masked(index: int) -> NDArray[np.bool_]:
            return np.unpackbits(left_out[index], axis=1, count=width).astype(bool)

        self.capture = replace(
            self.capture,
            valid=np.unpackbits(valid, axis=1, count=width).astype(bool),
            masked=masked if left_out.any() else None,
        )

    def _is_masked(self, index: int) -> bool:
        """Whether the mask of a frame may differ from that of the first."""
        frame = int(self._frames[index])
        lens = self._calibration.lens_index(frame)
        differs = lens != self._calibration.lens_index(int(self._frames[0])) and not self._valid.all()
        return differs or bool(self._calibration.mask(frame)) or _has_alpha(self._source, frame)

    def _shown(self, index: int) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of a rectified frame that ``valid.png``, its own mask and its transparency all leave."""
        frame = int(self._frames[index])
        shown = self._valid
        if path := self._calibration.mask(frame):
            shown = shown & read_mask(path, *shown.shape[::-1], turned=False)
        if _has_alpha(self._source, frame):
            shown = shown & self._source.read_opaque(frame)
        camera = self.capture.camera
        if rectifier := self._calibration.rectifier(frame):
            shown = rectifier.mask(shown)
        return resize_mask(shown, camera.width, camera.height)

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB frame of each index; see ``Recording.read_frames``.

        Raises:
            UserError: a frame cannot be decoded.
        """
        camera, frames = self.capture.camera, self._frames[indices]
        for frame, full in zip(frames.tolist(), self._source.read_frames(frames), strict=True):
            if _has_alpha(self._source, frame):
                # Below transparent pixels is any color.
                full = full * self._source.read_opaque(frame)[..., None]
            rectifier = self._calibration.rectifier(frame)
            image = resize_image(rectifier.image(full) if rectifier else full, camera.width, camera.height)
            image[~self.capture.valid] = 0
            yield image


@dataclass(frozen=True)
class _Calibration:
    """The lenses of a source's pictures, and their masks.

    Attributes:
        lenses: none, one for all pictures, or several.
        lens_of: the index of each picture's lens; empty for one lens.
        masks: the mask of each picture, or None; empty if there is none.
    """

    lenses: list[Lens]
    lens_of: list[int] = field(default_factory=list)
    masks: list[Path | None] = field(default_factory=list)

    @property
    def pinhole(self) -> Camera | None:
        """The camera of the rectified pictures; None without a lens."""
        if not self.lenses:
            return None
        return shared_pinhole(self.lenses, [max(1, self.lens_of.count(index)) for index in range(len(self.lenses))])

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


def _has_alpha(source: Video | ImageFolder, frame: int) -> bool:
    return isinstance(source, ImageFolder) and source.has_alpha(frame)


def picture_names(source: Video | ImageFolder) -> list[str]:
    """The path of each image from the folder, or the number of each frame of a video, from 0."""
    if isinstance(source, ImageFolder):
        return source.names
    return [str(number) for number in range(len(source.timestamp_ns))]


def fit(full: Camera, resolution: int, path: Path) -> tuple[int, int]:
    """Width and height of frames whose longer side is ``resolution`` [px]; a smaller source keeps its own, and the log says so.

    Raises:
        UserError: ``resolution`` is not positive.
    """
    longest = max(full.width, full.height)
    if resolution < 1:
        raise UserError(f"resolution: {resolution} px, but {path} has {longest}. Choose from 1 to {longest}.")
    if resolution > longest:
        log(f"{path.name}: frames keep their {longest} px, which are less than resolution: {resolution}")
    return shrunk_size(full.width, full.height, resolution)


def stride_advice(timestamp_ns: NDArray[np.int64], stride: int) -> str | None:
    """What to set if a recording whose poses COLMAP has to find has far more frames than it needs; None if it has not.

    Args:
        timestamp_ns: (N,) times of the selected frames.
        stride: with which they were selected.
    """
    span_s = float(timestamp_ns[-1] - timestamp_ns[0]) * 1e-9
    rate = (len(timestamp_ns) - 1) / span_s if span_s > 0 else 0.0
    if rate < 2 * ENOUGH_PER_S:
        return None
    return (
        f"{len(timestamp_ns)} frames, {rate:.0f} a second; frames.stride={stride * int(rate / ENOUGH_PER_S)} takes about "
        f"{ENOUGH_PER_S:.0f} a second, for which COLMAP takes a fraction of the time"
    )


def _guess_camera(width: int, height: int) -> Camera:
    focal = FOCAL_PRIOR * max(width, height)
    return Camera(width, height, focal, focal, width / 2, height / 2)


def _read_valid(path: Path, source: Video | ImageFolder) -> NDArray[np.bool_]:
    """The mask of the pictures' pixels that show the scene."""
    file = companion_path(path, VALID_MASK)
    if isinstance(source, ImageFolder) and len(set(source.sizes)) > 1 and os.path.lexists(file):
        raise UserError(f"{file}: the pictures have several sizes. Give each a mask_path in transforms.json instead.")
    return read_valid(file, source.width, source.height)


def _calibrate(path: Path, kind: str | None, source: Video | ImageFolder) -> _Calibration:
    """The calibration of full-size pictures: of the known poses, or of ``camera.json``; without lenses without either."""
    file = companion_path(path, CAMERA_FILE)
    # A broken link is not a missing file: reading it reports the error.
    calibrated = os.path.lexists(file)
    if kind is None:
        return _Calibration([read_camera_file(file, source.width, source.height)] if calibrated else [])
    known = companion_path(path, KNOWN_POSES[kind])
    if calibrated:
        raise UserError(
            f"{file}: {known.name} has a camera, too. Remove one, or set frames.known_poses=none."
        )
    contents = read_known_poses(path, kind, source.width, source.height)
    if isinstance(source, Video):
        check_numbers(contents.names, len(source.timestamp_ns), known)
    match = match_pictures(contents.names, picture_names(source), known)
    _log_known(path, known, contents, match, source)
    if len(contents.lenses) > 1:
        match = _only_matched(match, source)
    lens_of = contents.lens_of[match.row].tolist() if len(contents.lenses) > 1 else []
    masks = [contents.masks[row] if row >= 0 else None for row in match.row] if contents.masks else []
    calibration = _Calibration(contents.lenses, lens_of, masks)
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


def _check_sizes(calibration: _Calibration, source: Video | ImageFolder, camera_file: str) -> None:
    """Check that each picture has the size of its camera.

    Raises:
        UserError: one has not.
    """
    sizes = source.sizes if isinstance(source, ImageFolder) else [(source.width, source.height)]
    for frame, size in enumerate(sizes):
        lens = calibration.lenses[calibration.lens_index(frame)]
        if size != (lens.width, lens.height):
            turned = size[::-1] == (lens.width, lens.height)
            advice = " Are they turned? Write them as they are shown: magick mogrify -auto-orient" if turned else ""
            raise UserError(
                f"{camera_file}: for {lens.width}x{lens.height} px, but the frames are {size[0]}x{size[1]}"
                f" ({picture_names(source)[frame]}).{advice}"
            )


def _log_known(path: Path, known: Path, contents: Contents, match: Match, source: Video | ImageFolder) -> None:
    """Say what of the known poses and of the pictures does not count."""
    if contents.unread:
        log(f"{known}: these keys do not count: {', '.join(contents.unread)}")
    if line := unmatched_line(match, known):
        log(line)
    if isinstance(source, ImageFolder) and source.oriented:
        log(
            f"{path.name}: {source.oriented} pictures have an EXIF orientation, which the tools of {known.name} ignore: "
            "they are read as they are stored"
        )
    if (count := len(contents.lenses)) > 1:
        log(f"{known}: {count} cameras; the frames show what all of them see")
