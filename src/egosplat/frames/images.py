"""A folder of images as a source of pictures."""

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from egosplat.errors import UserError
from egosplat.progress import log

INTERVAL_NS = 1_000_000_000
"""An image folder has no clock: one image counts as one second, so that seconds are image numbers."""

VALID_MASK = "valid.png"
"""Beside the images, and none of them: which pixels show the scene."""

_SUFFIXES = (".png", ".jpg", ".jpeg")
_OTHER_SUFFIXES = (".gif", ".webp", ".tif", ".tiff", ".bmp", ".heic", ".heif", ".avif", ".jxl", ".dng")
"""Of pictures that are not read: some hold several pictures, more than 8 bits, or need libraries of their own."""

_EIGHT_BIT = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr")
_ORIENTATION_TAG, _TRANSPOSED = 0x0112, (5, 6, 7, 8)


class ImageFolder:
    """The png, jpg and jpeg images of a folder, in natural order (2 before 10); EXIF orientation is applied.

    Attributes:
        path: the folder.
        paths: the images.
        width, height: of each image as shown [px].
        timestamp_ns: (N,) int64: image number times ``INTERVAL_NS``.
    """

    def __init__(self, path: Path) -> None:
        """List the images and compare their sizes, without decoding them. Pictures of other formats are told of.

        Raises:
            UserError: there is no image, one is unreadable, two have one name, or sizes differ.
        """
        self.path = path
        files = [p for p in path.iterdir() if p.name != VALID_MASK and p.name[0] != "." and p.is_file()]
        self.paths = sorted((p for p in files if p.suffix.lower() in _SUFFIXES), key=natural_key)
        others = _told_of_others(files)
        if not self.paths:
            raise UserError(f"{path}: holds no png, jpg or jpeg image{f', but {others}' if others else '.'}")
        if others:
            log(f"{path}: ignores {others}")
        _check_names(self.paths)
        sizes = [_shown_size(image) for image in self.paths]
        (self.width, self.height), _ = Counter(sizes).most_common(1)[0]
        for image, (width, height) in zip(self.paths, sizes, strict=True):
            if (width, height) != (self.width, self.height):
                raise UserError(
                    f"{image}: {width}x{height} px, but most images of its folder are "
                    f"{self.width}x{self.height}. All must have one size."
                )
        self.timestamp_ns = np.arange(len(self.paths), dtype=np.int64) * INTERVAL_NS

    def pictures(self, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB picture of each image number; transparency is dropped.

        Raises:
            UserError: an image cannot be decoded.
        """
        for frame in frames:
            yield read_rgb(self.paths[frame])


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sort key that takes runs of digits for numbers; the name itself breaks ties (``1.png``, ``01.png``)."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts], path.name


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Decode an image to (H, W, 3) uint8 RGB as it is shown.

    Raises:
        UserError: it cannot be decoded, or has more than 8 bits a channel.
    """
    try:
        with Image.open(path) as image:
            if image.mode not in _EIGHT_BIT:
                raise UserError(f"{path}: pixels of type {image.mode}. Convert it to 8 bits a channel.")
            return np.array(ImageOps.exif_transpose(image).convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UserError(f"{path}: not an image that can be read ({error}).") from error


def read_valid(path: Path, width: int, height: int) -> NDArray[np.bool_]:
    """Read the mask of pixels that show the scene: (height, width) bool, true where the image is not black.

    A missing file means all pixels; a link that leads nowhere is not missing.

    Raises:
        UserError: it is unreadable, of another size, or leaves no pixel.
    """
    if not os.path.lexists(path):
        return np.ones((height, width), dtype=bool)
    mask = read_rgb(path).any(axis=2)
    if mask.shape != (height, width):
        raise UserError(f"{path}: {mask.shape[1]}x{mask.shape[0]} px, but the pictures are {width}x{height}.")
    if not mask.any():
        raise UserError(f"{path}: all black, which leaves no pixel. White pixels show the scene.")
    return mask


def _told_of_others(files: list[Path]) -> str:
    """How many pictures of which other formats there are, and how they are converted; empty where there is none."""
    counts = Counter(p.suffix for p in files if p.suffix.lower() in _OTHER_SUFFIXES)
    if not counts:
        return ""
    told = ", ".join(f"{count} {suffix}" for suffix, count in sorted(counts.items()))
    patterns = " ".join(f"*{suffix}" for suffix in sorted(counts))
    return f"{told}: only png and jpg are read. Convert them: magick mogrify -format png {patterns}"


def _check_names(images: list[Path]) -> None:
    """Refuse two images that differ in their extension alone: as one picture twice, they would be trained on and held
    out.
    """
    first: dict[str, Path] = {}
    for image in images:
        if (other := first.setdefault(image.stem, image)) is not image:
            raise UserError(
                f"{image.parent}: {other.name} and {image.name} are one picture twice. Remove one."
            )


def _shown_size(path: Path) -> tuple[int, int]:
    try:
        with Image.open(path) as image:
            width, height = image.size
            turned = image.getexif().get(_ORIENTATION_TAG) in _TRANSPOSED
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UserError(f"{path}: not an image that can be read ({error}).") from error
    return (height, width) if turned else (width, height)
