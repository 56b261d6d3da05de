"""Read a folder of images as a recording."""

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from egosplat.errors import UserError
from egosplat.frames.files import list_pictures
from egosplat.progress import log

# Time between images. A folder has no clock: one second per image makes seconds equal image numbers.
INTERVAL_NS = 1_000_000_000

# Not read: these formats may hold several images or more than 8 bits, or need further libraries.
_OTHER_SUFFIXES = (".gif", ".webp", ".tif", ".tiff", ".bmp", ".heic", ".heif", ".avif", ".jxl", ".dng")

_EIGHT_BIT = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr")
_ORIENTATION_TAG, _TRANSPOSED = 0x0112, (5, 6, 7, 8)


class ImageFolder:
    """The png, jpg and jpeg images of a folder, in natural order (2 before 10); EXIF orientation is applied.

    Attributes:
        paths: the images.
        width, height: size of every image after EXIF orientation [px].
        timestamp_ns: (N,) int64: image number times ``INTERVAL_NS``.
    """

    def __init__(self, path: Path) -> None:
        """List the images and check their sizes without decoding them; log ignored formats.

        Raises:
            UserError: there is no image, one is unreadable, two share a name, or sizes differ.
        """
        self.path = path
        self.paths = sorted(list_pictures(path), key=natural_key)
        others = _other_formats(path)
        if not self.paths:
            raise UserError(f"{path}: has no png, jpg or jpeg image{f', but {others}' if others else '.'}")
        if others:
            log(f"{path}: ignores {others}")
        _check_names(self.paths)
        sizes = [_shown_size(image) for image in self.paths]
        (self.width, self.height), _ = Counter(sizes).most_common(1)[0]
        for image, (width, height) in zip(self.paths, sizes, strict=True):
            if (width, height) != (self.width, self.height):
                raise UserError(
                    f"{image}: {width}x{height} px, but most images of the folder are "
                    f"{self.width}x{self.height}. All must have the same size."
                )
        self.timestamp_ns = np.arange(len(self.paths), dtype=np.int64) * INTERVAL_NS

    def read_frames(self, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB image of each number; transparency is dropped.

        Raises:
            UserError: an image cannot be decoded.
        """
        for frame in frames:
            yield read_rgb(self.paths[frame])


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sort key that compares runs of digits as numbers; the name breaks ties (``1.png``, ``01.png``)."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Decode an image to (H, W, 3) uint8 RGB, with EXIF orientation applied.

    Raises:
        UserError: it cannot be decoded, or has more than 8 bits per channel.
    """
    try:
        with Image.open(path) as image:
            if image.mode not in _EIGHT_BIT:
                raise UserError(f"{path}: pixels of type {image.mode}. Convert it to 8 bits per channel.")
            return np.array(ImageOps.exif_transpose(image).convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UserError(f"{path}: not a readable image ({error}).") from error


def read_valid(path: Path, width: int, height: int) -> NDArray[np.bool_]:
    """Read the mask of pixels that show the scene: (height, width) bool, True where the image is not black.

    A missing file means all pixels.

    Raises:
        UserError: the mask is unreadable, has another size, or is all black.
    """
    # A broken link is not a missing file: reading it reports the error.
    if not os.path.lexists(path):
        return np.ones((height, width), dtype=bool)
    mask = read_rgb(path).any(axis=2)
    if mask.shape != (height, width):
        raise UserError(f"{path}: {mask.shape[1]}x{mask.shape[0]} px, but the frames are {width}x{height}.")
    if not mask.any():
        raise UserError(f"{path}: all black, so no pixel is left. White pixels show the scene.")
    return mask


def _other_formats(folder: Path) -> str:
    """Number of images in formats that are not read, and the command that converts them; empty if there are none."""
    files = [path for path in folder.iterdir() if path.name[0] != "." and path.is_file()]
    counts = Counter(path.suffix for path in files if path.suffix.lower() in _OTHER_SUFFIXES)
    if not counts:
        return ""
    listed = ", ".join(f"{count} {suffix}" for suffix, count in sorted(counts.items()))
    patterns = " ".join(f"*{suffix}" for suffix in sorted(counts))
    return f"{listed}: only png and jpg are read. Convert them: magick mogrify -format png {patterns}"


def _check_names(images: list[Path]) -> None:
    """Reject two images whose names differ only in the extension."""
    # They are probably the same image: one copy would train and the other would be held out.
    first: dict[str, Path] = {}
    for image in images:
        if (other := first.setdefault(image.stem, image)) is not image:
            raise UserError(f"{image.parent}: {other.name} and {image.name} are the same image. Remove one.")


def _shown_size(path: Path) -> tuple[int, int]:
    try:
        with Image.open(path) as image:
            width, height = image.size
            turned = image.getexif().get(_ORIENTATION_TAG) in _TRANSPOSED
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UserError(f"{path}: not a readable image ({error}).") from error
    return (height, width) if turned else (width, height)
