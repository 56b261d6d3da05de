"""Import any video file or folder of pictures, with the companion files of docs/recordings.md."""

import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np

from egosplat.arrays import Bools, Bytes, Ints
from egosplat.calibration import known_poses
from egosplat.calibration.colmap.distortion import lens_of_frames
from egosplat.calibration.files import CAMERA_FILE, VALID_MASK, companion_path, known_poses_path
from egosplat.calibration.lens import Rectifier, read_camera_file
from egosplat.errors import UserError
from egosplat.frames.images import Source, read_mask
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat.frames.selection import select_frames
from egosplat.frames.video import Video, open_source
from egosplat.geometry import Camera
from egosplat.images import resize_image, resize_mask, shrunk_size
from egosplat.progress import log, track

# Guessed focal length in units of the longer side: COLMAP's default, a field of view of 45°.
FOCAL_PRIOR = 1.2

# Frames a second that show a walk well enough, and fewest of a video. COLMAP takes six times as long for thrice as many (docs/speed.md).
_ENOUGH_PER_S, _FEW = 3.0, 100

FindLabeled = Callable[[list[str]], list[int]]
# By its time, a phone's pictures may have a lens each, and a table of positions takes megabytes.
_rectifier = lru_cache(maxsize=4)(Rectifier)


@dataclass(frozen=True)
class Pictures:
    """The pictures of a source as frames.

    Attributes:
        valid: (h, w) bool: pixels of all full-size pictures that show the scene.
        pinhole: camera of the rectified full-size pictures; None if they are not rectified.
        size: width and height of the frames [px].
    """

    source: Source
    valid: Bools
    pinhole: Camera | None
    size: tuple[int, int]

    def _rectifier(self, index: int) -> Rectifier | None:
        picture = self.source.pictures[index]
        return _rectifier(self.source.lenses[picture.lens], self.pinhole) if self.source.lenses else None

    def read(self, indices: Ints, valid: Bools) -> Iterator[Bytes]:
        """Yield the rectified (H, W, 3) uint8 frame of each index, 0 outside of ``valid``; UserError if it is undecodable."""
        for index, full in zip(indices.tolist(), self.source.read_frames(indices), strict=True):
            if self.source.pictures[index].alpha:
                # Below transparent pixels is any color.
                full = full * self.source.read_opaque(index)[..., None]
            rectifier = self._rectifier(index)
            image = resize_image(rectifier.image(full) if rectifier else full, *self.size)
            image[~valid] = 0
            yield image

    @property
    def any_masked(self) -> bool:
        """Whether the mask of a frame may differ from that of the first."""
        first, bordered = self.source.pictures[0], not self.valid.all()
        return any(
            picture.alpha or picture.masks or (bordered and picture.lens != first.lens)
            for picture in self.source.pictures
        )

    def shown(self, index: int) -> Bools:
        """(H, W) bool: pixels of a rectified frame that ``valid``, its own masks and its transparency all leave."""
        picture, (width, height) = self.source.pictures[index], self.source.sizes[index]
        # With pictures of several sizes ``valid.png`` is refused.
        shown = self.valid if self.valid.shape == (height, width) else np.ones((height, width), bool)
        for path, hides in picture.masks:
            shown = shown & (read_mask(path, width, height) ^ hides)
        if picture.alpha:
            shown = shown & self.source.read_opaque(index)
        if rectifier := self._rectifier(index):
            shown = rectifier.mask(shown)
        return resize_mask(shown, *self.size)


def open_recording(path: Path, options: FramesOptions, find_labeled: FindLabeled | None = None) -> Recording:
    """Open a video or a folder of images; UserError if it or its calibration cannot be read, or no frame is selected.
    ``find_labeled`` gives indices of labeled pictures among names; these are taken whatever the stride."""
    kind = known_poses.find_known_poses(path, options.known_poses)
    every = calibrate(path, kind, open_source(path, kind))
    width, height = every.size
    focal = FOCAL_PRIOR * max(width, height)
    full = every.pinhole or Camera(width, height, focal, focal, width / 2, height / 2)
    if options.resolution > (longest := max(full.width, full.height)):
        log(f"{path.name}: frames keep their {longest} px, less than frames.resolution: {options.resolution}")
    size, valid = shrunk_size(full.width, full.height, options.resolution), _read_valid(path, every)
    frames, labeled = _choose_frames(every, path, options, find_labeled)
    pictures = Pictures(every.keep(frames), valid, every.pinhole, size)
    rate = (len(frames) - 1) / (float(np.ptp(pictures.source.timestamp_ns)) * 1e-9 or np.inf)
    if kind is None and (larger := stride_for(len(frames), rate)) > 1:
        stride = f"frames.stride={options.stride * larger}"
        log(f"{path.name}: {len(frames)} frames, {rate:.0f} a second; {stride} makes COLMAP faster")
    if not every.lenses and options.lens == "auto":
        pictures = _estimate_lens(pictures, full)
    source, pinhole = pictures.source, pictures.pinhole
    shown, left_out = _shared_mask(pictures)
    return Recording(
        timestamp_ns=source.timestamp_ns,
        exposure_middle_ns=source.timestamp_ns,
        camera=(pinhole or full).scaled_to(*size),
        camera_known=bool(every.lenses),
        valid=shown,
        read_frames=lambda indices: pictures.read(indices, shown),
        labeled=None if labeled is None else np.searchsorted(frames, labeled),
        masked=left_out,
        facts={
            "pictures": source.names,
            "known_poses": kind,
            "turned": source.turned,
            "pinhole": asdict(pinhole) if pinhole else None,
            "lenses": [asdict(lens) for lens in source.lenses],
            "lens_of_frame": [picture.lens for picture in source.pictures],
            "entry_of_frame": [picture.entry for picture in source.pictures],
        },
    )


def stride_for(count: int, rate: float) -> int:
    """Choose ``frames.stride`` for ``count`` frames at a rate [1/s]: enough frames for a walk, and not few."""
    return max(1, min(round(rate / _ENOUGH_PER_S), count // _FEW))


def calibrate(path: Path, kind: str | None, source: Source) -> Source:
    """Give full-size pictures the lenses and masks of the known poses, or the lens of ``camera.json``, if
    there is any. Pictures without a camera are left out where there are several cameras."""
    file = companion_path(path, CAMERA_FILE)
    # A broken link is not a missing file: reading it reports the error.
    calibrated = os.path.lexists(file)
    if kind is None:
        return replace(source, lenses=[read_camera_file(file, *source.size)]) if calibrated else source
    known = known_poses_path(path, kind)
    if calibrated:
        raise UserError(f"{file}: {known} has a camera, too. Remove one, or set frames.known_poses=none.")
    contents = known_poses.read_known_poses(path, kind, *source.size)
    if isinstance(source, Video):
        known_poses.check_numbers(contents.names, len(source.pictures), known)
    row, unmatched = known_poses.match_pictures(contents.names, source.names, known)
    if contents.unread:
        log(f"{known}: these keys do not count: {', '.join(contents.unread)}")
    if unmatched:
        log(f"{known}: ignores names without a picture: {len(unmatched)}, such as {unmatched[0]}")
    if len(contents.lenses) > 1:
        log(f"{known}: {len(contents.lenses)} cameras; the frames show what all of them see")
        if absent := int((row < 0).sum()):
            if isinstance(source, Video):
                raise UserError(f"{source.path}: a video has one camera, but its known poses have several.")
            log(f"{source.path}: leaves out {absent} pictures whose camera is not known")
            source, row = source.keep(np.flatnonzero(row >= 0)), row[row >= 0]
    if turned := sum(picture.orientation in (2, 3, 4) for picture in source.pictures):
        way = "turned by it" if isinstance(source, Video) else "as they are stored"
        log(f"{path}: {turned} frames have an orientation, as 180 degrees; {known} has to be of frames {way}")
    pictures, lens_of = [], contents.lens_of.tolist()
    for picture, entry in zip(source.pictures, row.tolist(), strict=True):
        mask = contents.masks[entry] if contents.masks and entry >= 0 else None
        masks = (*picture.masks, (mask, False)) if mask else picture.masks
        # Without an entry the last one stands, which has the only lens.
        pictures.append(replace(picture, lens=lens_of[entry], entry=entry, masks=masks))
    source = replace(source, pictures=pictures, lenses=contents.lenses)
    # COLMAP reads pictures as they are stored; they are turned by EXIF only if this is their camera's size.
    if _misfit(source) is not None and _misfit(turned := replace(source, turned=True)) is None:
        source = turned
        log(f"{known}: its cameras have the size of pictures that are turned by their EXIF orientation")
    if (index := _misfit(source)) is not None:
        lens, (width, height) = source.lenses[source.pictures[index].lens], source.sizes[index]
        of_frames = f"the frames are {width}x{height} ({source.names[index]}): give those of its size"
        raise UserError(f"{known}: for {lens.width}x{lens.height} px, but {of_frames}.")
    return source


def _misfit(source: Source) -> int | None:
    """The first picture that has not the size of its camera."""
    lenses = [source.lenses[picture.lens] for picture in source.pictures]
    misfits = [size != (lens.width, lens.height) for lens, size in zip(lenses, source.sizes, strict=True)]
    return misfits.index(True) if any(misfits) else None


def _read_valid(path: Path, source: Source) -> Bools:
    """The mask of the full-size pictures' pixels that show the scene."""
    file, (width, height) = companion_path(path, VALID_MASK), source.size
    # A broken link is not a missing file: reading it reports the error.
    if not os.path.lexists(file):
        return np.ones((height, width), dtype=bool)
    if len(set(source.sizes)) > 1:
        raise UserError(f"{file}: the pictures have several sizes. Give each a mask_path in transforms.json.")
    mask = read_mask(file, width, height)
    if not mask.any():
        raise UserError(f"{file}: all black, so no pixel is left. White pixels show the scene.")
    return mask


def _choose_frames(
    source: Source, path: Path, options: FramesOptions, find_labeled: FindLabeled | None
) -> tuple[Ints, Ints | None]:
    """The indices of the pictures that become frames, and of the labeled ones."""
    every = select_frames(source.timestamp_ns, options.change(stride=1), path)
    frames, labeled = every[:: options.stride], None
    if find_labeled is not None:
        matched = np.array(find_labeled(source.names), np.int64)
        if not len(labeled := np.intersect1d(matched, every)):
            at = f"labels are at {', '.join(map(str, matched))} s"
            raise UserError(f"{path}: no labeled picture is within frames.start_s and frames.end_s; {at}.")
        frames = np.union1d(frames, labeled)
    return frames, labeled


def _estimate_lens(pictures: Pictures, full: Camera) -> Pictures:
    """The pictures with the lens that frames of unknown cameras ask for, if any."""
    valid, count = resize_mask(pictures.valid, *pictures.size), len(pictures.source.pictures)
    camera, shown = full.scaled_to(*pictures.size), pictures.shown if pictures.any_masked else None
    lens = lens_of_frames(lambda at: pictures.read(at, valid), count, valid, camera, shown)
    if lens is None:
        return pictures
    source = replace(pictures.source, lenses=[lens.scaled_to(full.width, full.height)])
    return replace(pictures, source=source, pinhole=source.pinhole)


def _shared_mask(pictures: Pictures) -> tuple[Bools, Callable[[int], Bools] | None]:
    """(H, W) bool: the pixels that some frame shows; and what returns those of them that a frame leaves out, or None."""
    count = len(pictures.source.pictures)
    if not pictures.any_masked:
        return pictures.shown(0), None
    masks = track(map(pictures.shown, range(count)), "reading masks", total=count)
    shown = [np.packbits(mask, axis=1) for mask in masks]
    # What no frame shows is the picture's own border; the rest are pixels of single frames.
    valid = reduce(np.bitwise_or, shown)
    if not valid.any():
        shows = "White shows the scene (mask_path, valid.png); in dynamic_mask_*.png black does"
        raise UserError(f"{pictures.source.path}: masks leave no pixel of any picture. {shows}.")

    def unpacked(bits: Bytes) -> Bools:
        return np.unpackbits(bits, axis=1, count=pictures.size[0]).astype(bool)

    differ = any((bits != valid).any() for bits in shown)
    return unpacked(valid), (lambda index: unpacked(valid & ~shown[index])) if differ else None
