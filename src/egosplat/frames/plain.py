"""Read plain recordings: any video file or folder of images, with the companion files of docs/recordings.md."""

import os
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.colmap.distortion import lens_of_frames
from egosplat.calibration.companions import AUTO, KNOWN_POSES, companion_path
from egosplat.calibration.known_poses import (
    find_known_poses,
    match_pictures,
    read_known_poses,
    unmatched_line,
)
from egosplat.calibration.lens import Lens, Rectifier, read_camera_file
from egosplat.errors import UserError
from egosplat.frames.files import CAMERA_FILE, VALID_MASK
from egosplat.frames.images import ImageFolder, read_valid
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
        self._source = open_source(path)
        guess = _guess_camera(self._source.width, self._source.height)
        width, height = fit(guess, resolution, path)
        times, pictures = self._source.timestamp_ns, picture_names(self._source)
        kind = find_known_poses(path, known_poses)
        calibration = _read_lens(path, kind, guess, pictures)
        valid = read_valid(companion_path(path, VALID_MASK), guess.width, guess.height)
        self._rectifier: Rectifier | None = None
        # At full size, so that a reduced pixel is valid only if all its pixels are.
        reduced = resize_mask(valid, width, height)
        interval = {"start_s": start_s, "end_s": end_s, "source": path}
        self._frames = select_frames(times, stride=stride, **interval)
        if pick == SHARPEST and stride > 1:
            every = select_frames(times, stride=1, **interval)
            self._frames = select_sharpest(every, self._sharpness(every, reduced), stride)
        if kind is None and (line := stride_advice(times[self._frames], stride)):
            log(f"{path.name}: {line}")
        self.capture = Capture.of_video(times[self._frames], guess.scaled_to(width, height), False, reduced)
        estimated, evidence = None, None
        if calibration is None:
            estimated, evidence = lens_of_frames(
                lens, self.read_frames, len(self._frames), reduced, self.capture.camera
            )
        used = calibration or (estimated and estimated.scaled_to(guess.width, guess.height))
        if used:
            self._rectify(used, calibration is not None, valid)
        facts = {
            "pictures": [pictures[frame] for frame in self._frames],
            "known_poses": kind,
            "lens": asdict(used) if used else None,
            "lens_evidence": evidence,
        }
        self.capture = replace(self.capture, facts=facts)

    def _sharpness(self, frames: NDArray[np.int64], valid: NDArray[np.bool_]) -> Iterator[float]:
        """Yield the sharpness of frames of the source, reduced to the size of a mask."""
        for full in track(self._source.read_frames(frames), "looking for sharp frames", total=len(frames)):
            yield measure_sharpness(resize_image(full, *valid.shape[::-1]), valid)

    def _rectify(self, lens: Lens, known: bool, valid: NDArray[np.bool_]) -> None:
        """Rectify the frames from a lens; ``valid`` and ``lens`` are of full-size pictures."""
        self._rectifier = Rectifier(lens)
        width, height = self.capture.camera.width, self.capture.camera.height
        self.capture = replace(
            self.capture,
            camera=lens.pinhole.scaled_to(width, height),
            camera_known=known,
            valid=resize_mask(self._rectifier.mask(valid), width, height),
        )

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB frame of each index; see ``Recording.read_frames``.

        Raises:
            UserError: a frame cannot be decoded.
        """
        camera = self.capture.camera
        for full in self._source.read_frames(self._frames[indices]):
            rectified = self._rectifier.image(full) if self._rectifier else full
            image = resize_image(rectified, camera.width, camera.height)
            image[~self.capture.valid] = 0
            yield image


def picture_names(source: Video | ImageFolder) -> list[str]:
    """The file name of each image, or the number of each frame of a video, from 0."""
    if isinstance(source, ImageFolder):
        return [path.name for path in source.paths]
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


def _read_lens(path: Path, kind: str | None, guess: Camera, pictures: list[str]) -> Lens | None:
    """The calibration of full-size pictures: of the known poses, or of ``camera.json``; None without either."""
    file = companion_path(path, CAMERA_FILE)
    # A broken link is not a missing file: reading it reports the error.
    calibrated = os.path.lexists(file)
    if kind is None:
        return read_camera_file(file, guess.width, guess.height) if calibrated else None
    known = companion_path(path, KNOWN_POSES[kind])
    if calibrated:
        raise UserError(
            f"{file}: {known.name} has a camera, too. Remove one, or set frames.known_poses=none."
        )
    contents = read_known_poses(path, kind, guess.width, guess.height)
    if line := unmatched_line(match_pictures(contents.names, pictures, known), known):
        log(line)
    return contents.lens
