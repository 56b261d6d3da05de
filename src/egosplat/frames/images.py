"""Read images: single ones, masks, and a folder of images as a recording."""

import contextlib
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from egosplat.calibration.files import DYNAMIC_MASK, dynamic_masks, list_pictures
from egosplat.errors import UserError
from egosplat.progress import log

# Time between images. A folder has no clock: one second per image makes seconds equal image numbers.
INTERVAL_NS = 1_000_000_000

# Not read: these formats may hold several images or more than 8 bits, or need further libraries.
_OTHER_SUFFIXES = (".gif", ".webp", ".tif", ".tiff", ".bmp", ".heic", ".heif", ".avif", ".jxl", ".dng")

_EIGHT_BIT = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr")
_ORIENTATION_TAG, _UPRIGHT, _TRANSPOSED = 0x0112, 1, (5, 6, 7, 8)
# Compression leaves gray values where a mask is black.
_BLACK_OF_JPEG = 127


@dataclass(frozen=True)
class _Header:
    """What the head of an image's file says: size as stored [px], EXIF orientation, whether it has an alpha channel."""

    path: Path
    size: tuple[int, int]
    orientation: int
    alpha: bool


class ImageFolder:
    """The png, jpg and jpeg images of a folder, in natural order (2 before 10).

    Attributes:
        paths, names: of the images; names are paths from the folder.
        turned: whether EXIF orientation is applied.
        sizes: width and height of each [px]; ``width``, ``height``: the most common size.
        timestamp_ns: (N,) int64: image number times ``INTERVAL_NS``.
    """

    def __init__(self, path: Path, folders: Sequence[Path] | None = None, *, turned: bool = True) -> None:
        """Read the headers of images in folders of ``path``; UserError without any, or if one is damaged or twice there."""
        self.path, self.turned = path, turned
        folders = folders or [path]
        listed = [image for each in folders for image in sorted(list_pictures(each), key=natural_key)]
        others = _other_formats(folders)
        if not listed:
            raise UserError(f"{path}: has no png, jpg or jpeg image{f', but {others}' if others else '.'}")
        if others:
            log(f"{path}: ignores {others}")
        _check_names(listed)
        self._masks = {mask for each in folders for mask in dynamic_masks(each)}
        self._headers = [_read_header(image) for image in listed]
        self.timestamp_ns = np.arange(len(listed), dtype=np.int64) * INTERVAL_NS
        self._describe()
        if self._masks:
            used = sum(self.mask(frame) is not None for frame in range(len(listed)))
            log(f"{path}: {used} of {len(self._masks)} {DYNAMIC_MASK}*.png leave pixels of a picture out")

    def _describe(self) -> None:
        self.paths = [header.path for header in self._headers]
        self.names = [os.path.relpath(image, self.path) for image in self.paths]
        turned = [self.turned and header.orientation in _TRANSPOSED for header in self._headers]
        sizes = zip(self._headers, turned, strict=True)
        self.sizes = [header.size[::-1] if lies else header.size for header, lies in sizes]
        (self.width, self.height), _ = Counter(self.sizes).most_common(1)[0]

    def turn(self) -> None:
        """Apply EXIF orientation from now on."""
        self.turned = True
        self._describe()

    def keep(self, places: NDArray[np.int64]) -> None:
        """Keep the images at these places alone, at their times."""
        self.timestamp_ns = self.timestamp_ns[places]
        self._headers = [self._headers[place] for place in places]
        self._describe()

    @property
    def oriented(self) -> int:
        """Number of images with an EXIF orientation that is not upright."""
        return sum(header.orientation != _UPRIGHT for header in self._headers)

    def has_alpha(self, frame: int) -> bool:
        """Whether an image has transparent pixels, or may have."""
        return self._headers[frame].alpha

    def mask(self, frame: int) -> Path | None:
        """instant-ngp's mask of an image: pixels that are not black are left out; None without one."""
        picture = self.paths[frame]
        path = picture.with_name(f"{DYNAMIC_MASK}{picture.stem}.png")
        return path if path in self._masks else None

    def check_sizes(self) -> None:
        """Raise UserError unless all images have the same size."""
        for image, (width, height) in zip(self.paths, self.sizes, strict=True):
            if (width, height) != (self.width, self.height):
                raise UserError(
                    f"{image}: {width}x{height} px, but most images of the folder are "
                    f"{self.width}x{self.height}. All must have the same size."
                )

    def read_frames(self, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB image of each number, without transparency; UserError if undecodable."""
        for frame in frames:
            yield read_rgb(self.paths[frame], turned=self.turned)

    def read_opaque(self, frame: int) -> NDArray[np.bool_]:
        """(height, width) bool: pixels without any transparency; UserError if there is none, or it is undecodable."""
        path = self.paths[frame]
        opaque = _decode(path, "RGBA", self.turned)[..., 3] == 255
        if not opaque.any():
            raise UserError(
                f"{path}: no pixel is opaque. Remove its alpha channel: magick mogrify -alpha off {path.name}"
            )
        return opaque


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sort key that compares runs of digits as numbers; the name breaks ties (``1.png``, ``01.png``)."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name


@contextlib.contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """Open an image, which the block may decode; UserError if it cannot be read."""
    try:
        with Image.open(path) as image:
            yield image
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UserError(f"{path}: not a readable image ({error}).") from error


def _read_header(path: Path) -> _Header:
    with open_image(path) as image:
        orientation = image.getexif().get(_ORIENTATION_TAG, _UPRIGHT)
        return _Header(path, image.size, orientation, image.has_transparency_data)


def _decode(path: Path, mode: str, turned: bool) -> NDArray[np.uint8]:
    """Decode an image, turned upright or as stored; UserError if it is undecodable or has more than 8 bits a channel."""
    with open_image(path) as image:
        if image.mode not in _EIGHT_BIT:
            raise UserError(f"{path}: pixels of type {image.mode}. Convert it to 8 bits per channel.")
        return np.array((ImageOps.exif_transpose(image) if turned else image).convert(mode))


def read_rgb(path: Path, *, turned: bool = True) -> NDArray[np.uint8]:
    """Decode an image to (H, W, 3) uint8 RGB, turned by EXIF orientation or not; UserError if it is no 8-bit image."""
    return _decode(path, "RGB", turned)


def read_mask(path: Path, width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) bool, True where an image is not black; UserError if it is unreadable or of another size."""
    black = _BLACK_OF_JPEG if path.suffix.lower() in (".jpg", ".jpeg") else 0
    mask = (read_rgb(path) > black).any(axis=2)
    if mask.shape != (height, width):
        raise UserError(f"{path}: {mask.shape[1]}x{mask.shape[0]} px, but the frames are {width}x{height}.")
    return mask


def read_valid(path: Path, width: int, height: int) -> NDArray[np.bool_]:
    """``read_mask`` of the pixels that show the scene, not all black; all pixels without a file."""
    # A broken link is not a missing file: reading it reports the error.
    if not os.path.lexists(path):
        return np.ones((height, width), dtype=bool)
    mask = read_mask(path, width, height)
    if not mask.any():
        raise UserError(f"{path}: all black, so no pixel is left. White pixels show the scene.")
    return mask


def _other_formats(folders: Sequence[Path]) -> str:
    """Number of images in formats that are not read, and the command that converts them; empty if there are none."""
    files = [path for each in folders for path in each.iterdir() if path.name[0] != "." and path.is_file()]
    counts = sorted(Counter(path.suffix for path in files if path.suffix.lower() in _OTHER_SUFFIXES).items())
    listed = ", ".join(f"{count} {suffix}" for suffix, count in counts)
    patterns = " ".join(f"*{suffix}" for suffix, _ in counts)
    advice = f": only png and jpg are read. Convert them: magick mogrify -format png {patterns}"
    return listed and listed + advice


def _check_names(images: list[Path]) -> None:
    """Reject two images whose names differ only in the extension."""
    # They are probably the same image: one copy would train and the other would be held out.
    first: dict[Path, Path] = {}
    for image in images:
        if (other := first.setdefault(image.with_suffix(""), image)) is not image:
            raise UserError(f"{image.parent}: {other.name} and {image.name} are the same image. Remove one.")
