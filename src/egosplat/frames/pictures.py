"""Read the frames of any video file or folder of images, with the companion files of docs/recordings.md."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.colmap.distortion import lens_of_frames
from egosplat.calibration.companions import companion_path
from egosplat.calibration.known_poses import find_known_poses
from egosplat.errors import UserError
from egosplat.frames.files import VALID_MASK
from egosplat.frames.images import ImageFolder, read_mask, read_valid
from egosplat.frames.labels import match_labels
from egosplat.frames.options import FramesOptions
from egosplat.frames.picture_cameras import Calibration, calibrate
from egosplat.frames.recording import Capture
from egosplat.frames.selection import SHARPEST, select_frames, select_sharpest
from egosplat.frames.video import Video, open_source
from egosplat.geometry import Camera
from egosplat.images import measure_sharpness, resize_image, resize_mask, shrunk_size
from egosplat.progress import log, track

# Guessed focal length in units of the longer side: COLMAP's default, a field of view of 45°.
FOCAL_PRIOR = 1.2

# Frames per second that show a walk well enough. COLMAP takes six times as long for three times as many (docs/speed.md).
ENOUGH_PER_S = 3.0


class PlainRecording:
    """A video or a folder of images; a ``Recording`` without a device frame."""

    def __init__(self, path: Path, options: FramesOptions, labels: Mapping[str, Path] | None = None) -> None:
        """Open a video or a folder of images, one a second; select frames and find the camera.

        Args:
            labels: of pictures by their names, see ``labels.match_labels``; these pictures are taken whatever the stride.

        Raises:
            UserError: the source or the calibration cannot be read, or no frame is selected.
        """
        kind, stride = find_known_poses(path, options.known_poses), options.stride
        self._source = open_source(path, kind)
        self._calibration = calibrate(path, kind, self._source)
        width, height = self._source.width, self._source.height
        focal = FOCAL_PRIOR * max(width, height)
        full = self._calibration.pinhole or Camera(width, height, focal, focal, width / 2, height / 2)
        width, height = fit(full, options.resolution, path)
        times, pictures = self._source.timestamp_ns, self._source.names
        self._valid = _read_valid(path, self._source)
        # At full size, so that a reduced pixel is valid only if all its pixels are.
        reduced = resize_mask(self._valid, width, height)
        every = select_frames(times, options, path, stride=1)
        self._frames = select_frames(times, options, path)
        if labels is not None:
            labeled = self._find_labeled(labels, every)
            self._frames = np.union1d(self._frames, labeled)
        if options.pick == SHARPEST and stride > 1:
            self._frames = select_sharpest(every, self._sharpness(every, reduced), stride)
        if kind is None and (line := stride_advice(times[self._frames], stride)):
            log(f"{path.name}: {line}")
        self.capture = Capture.of_video(times[self._frames], full.scaled_to(width, height), False, reduced)
        if labels is not None:
            self.capture = replace(self.capture, labeled=np.searchsorted(self._frames, labeled))
        evidence, calibrated = None, bool(self._calibration.lenses)
        if not calibrated:
            count = len(self._frames)
            masked = any(self._is_masked(index) for index in range(count))
            estimated, evidence = lens_of_frames(
                options.lens,
                self.read_frames,
                count,
                reduced,
                self.capture.camera,
                self._shown if masked else None,
            )
            self._calibration = Calibration(
                [estimated.scaled_to(full.width, full.height)] if estimated else []
            )
        self._finish(calibrated)
        of_frame = [self._calibration.lens_index(frame) for frame in self._frames.tolist()]
        facts = {
            "pictures": [pictures[frame] for frame in self._frames],
            "known_poses": kind,
            "turned": self._source.turned,
            "pinhole": asdict(pinhole) if (pinhole := self._calibration.pinhole) else None,
            "lenses": [asdict(one) for one in self._calibration.lenses],
            "lens_of_frame": of_frame,
            "lens_evidence": evidence,
        }
        self.capture = replace(self.capture, facts=facts)

    def _find_labeled(self, labels: Mapping[str, Path], frames: NDArray[np.int64]) -> NDArray[np.int64]:
        """The labeled ones of the frames of a time range."""
        places = np.array([*match_labels(labels, self._source.names)], np.int64)
        if not len(labeled := np.intersect1d(places, frames)):
            raise UserError(
                f"{self._source.path}: none of its {len(places)} labeled pictures is within frames.start_s and frames.end_s; "
                f"these are pictures {', '.join(map(str, places))}, one a second."
            )
        return labeled

    def _sharpness(self, frames: NDArray[np.int64], valid: NDArray[np.bool_]) -> Iterator[float]:
        """Yield the sharpness of frames of the source, reduced to the size of a mask."""
        for full in track(self._source.read_frames(frames), "looking for sharp frames", total=len(frames)):
            yield measure_sharpness(resize_image(full, *valid.shape[::-1]), valid)

    def _finish(self, known: bool) -> None:
        """Set the camera of the rectified frames, the pixels that show the scene, and those that single frames leave out."""
        width, height = self.capture.camera.width, self.capture.camera.height
        if pinhole := self._calibration.pinhole:
            self.capture = replace(self.capture, camera=pinhole.scaled_to(width, height), camera_known=known)
        count = len(self._frames)
        if not any(self._is_masked(index) for index in range(count)):
            self.capture = replace(self.capture, valid=self._shown(0))
            return
        frames = track(range(count), "reading masks", total=count)
        shown = np.stack([np.packbits(self._shown(index), axis=1) for index in frames])
        # What no frame shows is the picture's own border; the rest are pixels of single frames.
        valid = np.bitwise_or.reduce(shown)
        if not valid.any():
            raise UserError(
                f"{self._source.path}: masks leave no pixel of any picture. White shows the scene (mask_path of "
                "transforms.json, valid.png); in dynamic_mask_*.png black does."
            )
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
        masks = self._calibration.mask(frame), self._source.mask(frame)
        return differs or any(masks) or self._source.has_alpha(frame)

    def _shown(self, index: int) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of a rectified frame that ``valid.png``, its own mask and its transparency all leave."""
        frame = int(self._frames[index])
        shown, (width, height) = self._valid, self._source.sizes[frame]
        if shown.shape != (height, width):
            # With pictures of several sizes ``valid.png`` is refused.
            shown = np.ones((height, width), bool)
        if path := self._calibration.mask(frame):
            shown = shown & read_mask(path, width, height)
        if path := self._source.mask(frame):
            shown = shown & ~read_mask(path, width, height)
        if self._source.has_alpha(frame):
            shown = shown & self._source.read_opaque(frame)
        camera = self.capture.camera
        if rectifier := self._calibration.rectifier(frame):
            shown = rectifier.mask(shown)
        return resize_mask(shown, camera.width, camera.height)

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """See ``Recording.read_frames``; UserError if a frame cannot be decoded."""
        camera, frames = self.capture.camera, self._frames[indices]
        for frame, full in zip(frames.tolist(), self._source.read_frames(frames), strict=True):
            if self._source.has_alpha(frame):
                # Below transparent pixels is any color.
                full = full * self._source.read_opaque(frame)[..., None]
            rectifier = self._calibration.rectifier(frame)
            image = resize_image(rectifier.image(full) if rectifier else full, camera.width, camera.height)
            image[~self.capture.valid] = 0
            yield image


open_recording = PlainRecording


def fit(full: Camera, resolution: int, path: Path) -> tuple[int, int]:
    """Width and height of frames whose longer side is ``resolution`` [px]; a smaller source keeps its own, and the log says so."""
    longest = max(full.width, full.height)
    if resolution > longest:
        log(f"{path.name}: frames keep their {longest} px, which are less than resolution: {resolution}")
    return shrunk_size(full.width, full.height, resolution)


def stride_advice(timestamp_ns: NDArray[np.int64], stride: int) -> str | None:
    """What to set if COLMAP has to find poses of far more frames, at (N,) times, than it needs; None if it has not."""
    span_s = float(timestamp_ns[-1] - timestamp_ns[0]) * 1e-9
    rate = (len(timestamp_ns) - 1) / span_s if span_s > 0 else 0.0
    if rate < 2 * ENOUGH_PER_S:
        return None
    return (
        f"{len(timestamp_ns)} frames, {rate:.0f} a second; frames.stride={stride * int(rate / ENOUGH_PER_S)} takes about "
        f"{ENOUGH_PER_S:.0f} a second, for which COLMAP takes a fraction of the time"
    )


def _read_valid(path: Path, source: Video | ImageFolder) -> NDArray[np.bool_]:
    """The mask of the pictures' pixels that show the scene."""
    file = companion_path(path, VALID_MASK)
    if len(set(source.sizes)) > 1 and os.path.lexists(file):
        raise UserError(
            f"{file}: the pictures have several sizes. Give each a mask_path in transforms.json instead."
        )
    return read_valid(file, source.width, source.height)
