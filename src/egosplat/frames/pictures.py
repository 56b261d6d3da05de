"""Import any video file or folder of pictures, with the companion files of docs/recordings.md."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.colmap.distortion import lens_of_frames
from egosplat.calibration.files import VALID_MASK, companion_path
from egosplat.calibration.known_poses import find_known_poses
from egosplat.errors import UserError
from egosplat.frames.images import ImageFolder, read_mask, read_valid
from egosplat.frames.labels import match_labels
from egosplat.frames.options import FramesOptions
from egosplat.frames.picture_lenses import Lenses, calibrate
from egosplat.frames.recording import Recording
from egosplat.frames.selection import SHARPEST, select_frames, select_sharpest
from egosplat.frames.video import Video, open_source
from egosplat.geometry import Camera
from egosplat.images import measure_sharpness, resize_image, resize_mask, shrunk_size
from egosplat.progress import log, track

# Guessed focal length in units of the longer side: COLMAP's default, a field of view of 45°.
FOCAL_PRIOR = 1.2

# Frames per second that show a walk well enough. COLMAP takes six times as long for three times as many (docs/speed.md).
ENOUGH_PER_S = 3.0


@dataclass(frozen=True)
class Pictures:
    """The pictures of a source that become frames.

    Attributes:
        frames: (F,) int64 numbers of the pictures.
        valid: (h, w) bool: pixels of all full-size pictures that show the scene.
        width, height: of the frames [px].
    """

    source: Video | ImageFolder
    frames: NDArray[np.int64]
    lenses: Lenses
    valid: NDArray[np.bool_]
    width: int
    height: int

    def read(self, indices: NDArray[np.int64], valid: NDArray[np.bool_]) -> Iterator[NDArray[np.uint8]]:
        """Yield the rectified (H, W, 3) uint8 frame of each index, 0 outside of ``valid``; UserError if it is undecodable."""
        frames = self.frames[indices]
        for frame, full in zip(frames.tolist(), self.source.read_frames(frames), strict=True):
            if self.source.has_alpha(frame):
                # Below transparent pixels is any color.
                full = full * self.source.read_opaque(frame)[..., None]
            rectifier = self.lenses.rectifier(frame)
            image = resize_image(rectifier.image(full) if rectifier else full, self.width, self.height)
            image[~valid] = 0
            yield image

    def is_masked(self, index: int) -> bool:
        """Whether the mask of a frame may differ from that of the first."""
        frame = int(self.frames[index])
        differs = self.lenses.index(frame) != self.lenses.index(int(self.frames[0])) and not self.valid.all()
        masks = self.lenses.mask(frame), self.source.mask(frame)
        return differs or any(masks) or self.source.has_alpha(frame)

    @property
    def any_masked(self) -> bool:
        return any(self.is_masked(index) for index in range(len(self.frames)))

    def shown(self, index: int) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of a rectified frame that ``valid``, its own mask and its transparency all leave."""
        frame = int(self.frames[index])
        width, height = self.source.sizes[frame]
        # With pictures of several sizes ``valid.png`` is refused.
        shown = self.valid if self.valid.shape == (height, width) else np.ones((height, width), bool)
        if path := self.lenses.mask(frame):
            shown = shown & read_mask(path, width, height)
        if path := self.source.mask(frame):
            shown = shown & ~read_mask(path, width, height)
        if self.source.has_alpha(frame):
            shown = shown & self.source.read_opaque(frame)
        if rectifier := self.lenses.rectifier(frame):
            shown = rectifier.mask(shown)
        return resize_mask(shown, self.width, self.height)


def open_recording(path: Path, options: FramesOptions, labels: Mapping[str, Path] | None = None) -> Recording:
    """Open a video or a folder of images, one a second; select frames and find the camera.

    Args:
        labels: of pictures by their names, see ``labels.match_labels``; these pictures are taken whatever the stride.

    Raises:
        UserError: the source or the calibration cannot be read, or no frame is selected.
    """
    kind = find_known_poses(path, options.known_poses)
    source = open_source(path, kind)
    lenses = calibrate(path, kind, source)
    focal = FOCAL_PRIOR * max(source.width, source.height)
    guess = Camera(source.width, source.height, focal, focal, source.width / 2, source.height / 2)
    full = lenses.pinhole or guess
    size = fit(full, options.resolution, path)
    valid = _read_valid(path, source)
    frames, labeled = _choose_frames(source, path, options, labels, resize_mask(valid, *size))
    times = source.timestamp_ns[frames]
    if kind is None and (line := stride_advice(times, options.stride)):
        log(f"{path.name}: {line}")
    pictures, evidence = Pictures(source, frames, lenses, valid, *size), None
    if not (known := bool(lenses.lenses)):
        lenses, evidence = _estimate_lens(pictures, full, options.lens)
        pictures = Pictures(source, frames, lenses, valid, *size)
    facts = {
        "pictures": [source.names[frame] for frame in frames],
        "known_poses": kind,
        "turned": source.turned,
        "pinhole": asdict(pinhole) if (pinhole := lenses.pinhole) else None,
        "lenses": [asdict(lens) for lens in lenses.lenses],
        "lens_of_frame": [lenses.index(frame) for frame in frames.tolist()],
        "lens_evidence": evidence,
    }
    shown, left_out = _shared_mask(pictures)
    return Recording(
        timestamp_ns=times,
        exposure_middle_ns=times,
        camera=(lenses.pinhole or full).scaled_to(*size),
        camera_known=known,
        valid=shown,
        read_frames=lambda indices: pictures.read(indices, shown),
        labeled=None if labeled is None else np.searchsorted(frames, labeled),
        masked=left_out,
        facts=facts,
    )


def fit(full: Camera, resolution: int, path: Path) -> tuple[int, int]:
    """Width and height of frames whose longer side is ``resolution`` [px]; a smaller source keeps its own, and the log says so."""
    longest = max(full.width, full.height)
    if resolution > longest:
        log(f"{path.name}: frames keep their {longest} px, which are less than resolution: {resolution}")
    return shrunk_size(full.width, full.height, resolution)


def _choose_frames(
    source: Video | ImageFolder,
    path: Path,
    options: FramesOptions,
    labels: Mapping[str, Path] | None,
    valid: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """The numbers of the pictures that become frames, and of the labeled ones; sharpness is measured at the size of a mask."""
    every = select_frames(source.timestamp_ns, options, path, stride=1)
    frames, labeled = select_frames(source.timestamp_ns, options, path), None
    if labels is not None:
        places = np.array([*match_labels(labels, source.names)], np.int64)
        if not len(labeled := np.intersect1d(places, every)):
            raise UserError(
                f"{source.path}: none of its {len(places)} labeled pictures is within frames.start_s and frames.end_s; "
                f"these are pictures {', '.join(map(str, places))}, one a second."
            )
        frames = np.union1d(frames, labeled)
    if options.pick == SHARPEST and options.stride > 1:
        pictures = track(source.read_frames(every), "looking for sharp frames", total=len(every))
        sharpness = (measure_sharpness(resize_image(each, *valid.shape[::-1]), valid) for each in pictures)
        frames = select_sharpest(every, sharpness, options.stride)
    return frames, labeled


def _estimate_lens(pictures: Pictures, full: Camera, wanted: str) -> tuple[Lenses, dict | None]:
    """The lens that frames of unknown cameras ask for, if any, and the evidence."""
    valid = resize_mask(pictures.valid, pictures.width, pictures.height)
    lens, evidence = lens_of_frames(
        wanted,
        lambda indices: pictures.read(indices, valid),
        len(pictures.frames),
        valid,
        full.scaled_to(pictures.width, pictures.height),
        pictures.shown if pictures.any_masked else None,
    )
    return Lenses([lens.scaled_to(full.width, full.height)] if lens else []), evidence


def _shared_mask(pictures: Pictures):
    """(H, W) bool: the pixels that some frame shows; and what returns those of them that a frame leaves out, or None."""
    count = len(pictures.frames)
    if not pictures.any_masked:
        return pictures.shown(0), None
    masks = track(map(pictures.shown, range(count)), "reading masks", total=count)
    shown = np.stack([np.packbits(mask, axis=1) for mask in masks])
    # What no frame shows is the picture's own border; the rest are pixels of single frames.
    valid = np.bitwise_or.reduce(shown)
    if not valid.any():
        raise UserError(
            f"{pictures.source.path}: masks leave no pixel of any picture. White shows the scene (mask_path of "
            "transforms.json, valid.png); in dynamic_mask_*.png black does."
        )
    left_out = valid & ~shown

    def unpacked(bits: NDArray[np.uint8]) -> NDArray[np.bool_]:
        return np.unpackbits(bits, axis=1, count=pictures.width).astype(bool)

    return unpacked(valid), (lambda index: unpacked(left_out[index])) if left_out.any() else None


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
