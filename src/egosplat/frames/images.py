"""Read images: single ones, masks, and a folder of pictures as a recording."""

import contextlib
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from shlex import quote

import numpy as np
from PIL import Image

from egosplat.arrays import Bools, Bytes, Ints
from egosplat.calibration.files import DYNAMIC_MASK, OTHER_PICTURES, dynamic_masks, list_pictures
from egosplat.calibration.lens import Lens, shared_pinhole
from egosplat.errors import UserError, reraise_as
from egosplat.geometry import Camera
from egosplat.progress import log

# Time between images. A folder has no clock: one second per image makes seconds equal image numbers.
INTERVAL_NS = 1_000_000_000

# The largest cameras have fewer; Pillow warns from 89 million.
_MOST_PIXELS, Image.MAX_IMAGE_PIXELS = 2**28, None
_EIGHT_BIT = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr")
_ORIENTATION_TAG, _TRANSPOSED = 0x0112, (5, 6, 7, 8)
# Of orientations 2 to 8: mirror, 180 degrees, upside down, transpose, 270 degrees, transverse, 90 degrees.
_TURNS = dict(zip(range(2, 9), map(Image.Transpose, (0, 3, 1, 5, 4, 6, 2)), strict=True))
# What names EXIF in a PNG: to find some behind the pixels, Pillow decodes these, in 300 times the time of a header.
_EXIF = (b"eXIf", b"Raw profile type exif", b"XML:com.adobe.xmp")
# Compression leaves gray values where a mask is black.
_BLACK_OF_JPEG = 127


@dataclass(frozen=True)
class Picture:
    """A picture of a folder or a frame of a video, before it is decoded.

    Attributes:
        path, name: its file or the video, and its path from the folder or the frame's number from 0.
        stored: width and height in the file [px].
        orientation, alpha: by EXIF, and whether it may have transparent pixels.
        masks: each with whether its pixels that are not black are left out, as instant-ngp's are, or its black ones.
        lens, entry: the index of its lens, and of its entry in the known poses, -1 for none.
    """

    path: Path
    name: str
    stored: tuple[int, int]
    orientation: int = 1
    alpha: bool = False
    masks: tuple[tuple[Path, bool], ...] = ()
    lens: int = 0
    entry: int = -1


@dataclass(frozen=True)
class Source:
    """The pictures of a folder.

    Attributes:
        timestamp_ns: (N,) int64 time of each picture since the first.
        turned: whether EXIF orientation is applied.
        lenses: of full-size pictures; none if they are not known.
    """

    path: Path
    pictures: list[Picture]
    timestamp_ns: Ints
    turned: bool = False
    lenses: list[Lens] = field(default_factory=list)

    @cached_property
    def sizes(self) -> list[tuple[int, int]]:
        """Width and height of each picture [px]."""
        lies = [self.turned and picture.orientation in _TRANSPOSED for picture in self.pictures]
        stored = [picture.stored for picture in self.pictures]
        return [(h, w) if lie else (w, h) for lie, (w, h) in zip(lies, stored, strict=True)]

    @property
    def size(self) -> tuple[int, int]:
        """The most common width and height."""
        return Counter(self.sizes).most_common(1)[0][0]

    @property
    def names(self) -> list[str]:
        return [picture.name for picture in self.pictures]

    @cached_property
    def pinhole(self) -> Camera | None:
        """The camera of the rectified pictures; None without a lens."""
        share = np.bincount([picture.lens for picture in self.pictures], minlength=len(self.lenses))
        return shared_pinhole(self.lenses, share.tolist()) if self.lenses else None

    def keep(self, indices: Ints) -> "Source":
        """The source of some pictures alone, at their times."""
        kept = [self.pictures[index] for index in indices]
        return replace(self, pictures=kept, timestamp_ns=self.timestamp_ns[indices])

    def read_frames(self, indices: Ints) -> Iterator[Bytes]:
        """Yield the (height, width, 3) uint8 RGB picture of each index, without transparency; UserError if undecodable."""
        for index in indices:
            yield read_rgb(self.pictures[index].path, turned=self.turned)

    def read_opaque(self, index: int) -> Bools:
        """(height, width) bool: pixels without any transparency; UserError if there is none, or it is undecodable."""
        path = self.pictures[index].path
        opaque = read_rgb(path, turned=self.turned, alpha=True)[..., 3] == 255
        if not opaque.any():
            remove = f"Remove its alpha channel: magick mogrify -alpha off {quote(str(path))}"
            raise UserError(f"{path}: no pixel is opaque. {remove}")
        return opaque


def open_folder(path: Path, folders: Sequence[Path], *, turned: bool) -> Source:
    """Read the headers of the png, jpg and jpeg pictures in folders of ``path``, one a second in natural
    order (2 before 10). UserError if there is no picture, or one is damaged or twice there."""
    listed = [image for each in folders for image in sorted(list_pictures(each), key=natural_key)]
    others = _other_formats(folders)
    if not listed:
        raise UserError(f"{path}: has no png, jpg or jpeg image{f', but {others}' if others else '.'}")
    if others:
        log(f"{path}: ignores {others}")
    # Two of one name are probably the same image: one copy would train and the other would be held out.
    first: dict[Path, Path] = {}
    for image in listed:
        if (other := first.setdefault(image.with_suffix(""), image)) is not image:
            raise UserError(f"{image.parent}: {other.name} and {image.name} are the same image. Remove one.")
    masks = {mask for each in folders for mask in dynamic_masks(each)}
    pictures = [_read_header(image, path, masks) for image in listed]
    if masks:
        used = sum(len(picture.masks) for picture in pictures)
        log(f"{path}: {used} of {len(masks)} {DYNAMIC_MASK}*.png leave pixels of a picture out")
    return Source(path, pictures, np.arange(len(pictures), dtype=np.int64) * INTERVAL_NS, turned)


def _read_header(path: Path, folder: Path, masks: set[Path]) -> Picture:
    moving = path.with_name(f"{DYNAMIC_MASK}{path.stem}.png")
    with open_image(path) as image:
        content = path.read_bytes() if image.format == "PNG" else _EXIF[0]
        exif = image.getexif() if any(word in content for word in _EXIF) else {}
        orientation, alpha = exif.get(_ORIENTATION_TAG, 1), image.has_transparency_data
        own = ((moving, True),) if moving in masks else ()
        return Picture(path, os.path.relpath(path, folder), image.size, orientation, alpha, own)


def _other_formats(folders: Sequence[Path]) -> str:
    """Number of images in formats that are not read, and the command that converts them; empty if there are none."""
    files = [path for each in folders for path in each.iterdir() if path.name[0] != "." and path.is_file()]
    counts = sorted(Counter(path.suffix for path in files if path.suffix.lower() in OTHER_PICTURES).items())
    listed = ", ".join(f"{count} {suffix}" for suffix, count in counts)
    places = {(path.parent, path.suffix): None for path in files if path.suffix in dict(counts)}
    patterns = " ".join(f"{quote(str(folder))}/*{suffix}" for folder, suffix in sorted(places))
    advice = f": only png and jpg are read. Convert them: magick mogrify -format png {patterns}"
    return listed and listed + advice


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sort key that compares runs of digits as numbers; the name breaks ties (``1.png``, ``01.png``)."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name


@contextlib.contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """Open an image, which the block may decode; UserError if it cannot be read."""

    def told(error: Exception) -> UserError:
        return UserError(f"{path}: not a readable image ({error}). Copy it again, or remove it.")

    with reraise_as(told, (OSError, ValueError, SyntaxError)), Image.open(path) as image:
        if image.width * image.height > _MOST_PIXELS:
            shrink = f"magick mogrify -resize 8192x8192 {quote(str(path))}"
            raise UserError(f"{path}: is larger than {_MOST_PIXELS:,} pixels. Shrink it: {shrink}")
        yield image


def read_rgb(path: Path, *, turned: bool = True, alpha: bool = False) -> Bytes:
    """Decode an image to (H, W, 3) uint8 RGB, or 4 with alpha, turned by EXIF or not; UserError if it is no 8-bit image."""
    with open_image(path) as image:
        if image.mode not in _EIGHT_BIT:
            raise UserError(f"{path}: pixels of type {image.mode}, as of depth. Give photographs of 8 bits.")
        # Not by ``ImageOps.exif_transpose``, which writes the EXIF anew, and fails where a tag is damaged.
        turn = _TURNS.get(image.getexif().get(_ORIENTATION_TAG, 1)) if turned else None
        upright = image if turn is None else image.transpose(turn)
        return np.array(upright.convert("RGBA" if alpha else "RGB"))


def read_mask(path: Path, width: int, height: int) -> Bools:
    """(height, width) bool, True where an image is not black; UserError if it is unreadable or of another size."""
    black = _BLACK_OF_JPEG if path.suffix.lower() in (".jpg", ".jpeg") else 0
    mask: Bools = np.any(read_rgb(path) > black, axis=2)
    if mask.shape != (height, width):
        raise UserError(f"{path}: {mask.shape[1]}x{mask.shape[0]} px, but the frames are {width}x{height}.")
    return mask
