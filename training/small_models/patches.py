"""Square patches of images: around a mask, or a tile anywhere."""

import cv2
import numpy as np
from numpy.typing import NDArray

# Side of a patch, and of the mask's bounding square in it.
PATCH_PX, INNER_PX = 72, 64

# Sides of LERF's smallest and largest tiles, as fractions of the image's height.
SMALLEST, LARGEST = 0.05, 0.5

# A tile is kept if one whole fills at least the first fraction of it, and no other whole the second.
_MOST, _OTHER = 0.5, 0.25


def cut_patch(rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], int]:
    """A (PATCH_PX, PATCH_PX, 4) patch of an image around a mask, and the side of its bounding square [px].

    Args:
        rgb: (H, W, 3); mask: (H, W), not empty. Outside the image both count as 0.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    side = max(bottom - top, right - left)
    # A margin in whole pixels, at least one.
    margin = max(1, round(side * (PATCH_PX - INNER_PX) / 2 / INNER_PX))
    width = side + 2 * margin
    y0, x0 = (top + bottom - width) // 2, (left + right - width) // 2
    square = np.zeros((width, width, 4), dtype=np.uint8)
    y, x = (
        slice(max(0, y0), min(mask.shape[0], y0 + width)),
        slice(max(0, x0), min(mask.shape[1], x0 + width)),
    )
    inside = square[y.start - y0 : y.stop - y0, x.start - x0 : x.stop - x0]
    inside[..., :3], inside[..., 3] = rgb[y, x], 255 * mask[y, x]
    way = cv2.INTER_AREA if width > PATCH_PX else cv2.INTER_LINEAR
    return cv2.resize(square, (PATCH_PX, PATCH_PX), interpolation=way), int(side)


def draw_side(height: int, rng: np.random.Generator) -> int:
    """Draw the side of a tile [px]; all sizes are equally likely on a logarithmic scale."""
    return max(2, round(height * SMALLEST * (LARGEST / SMALLEST) ** rng.random()))


def cut_tile(
    rgb: NDArray[np.uint8], wholes: NDArray[np.int32], row: int, column: int, side: int
) -> tuple[NDArray[np.uint8], int, int] | None:
    """Cut a tile around a pixel.

    Args:
        rgb: (H, W, 3); wholes: (H, W) number of each pixel's whole, -1 for none. The tile can lie partly outside
            the image, where it is black.
        row, column: the pixel in the middle; side: of the tile [px].

    Returns:
        its (PATCH_PX, PATCH_PX, 4) patch, the number of the whole that fills most of it, and that whole's pixels;
        None if it is not clear what the tile shows.
    """
    shown = np.pad(wholes, side, constant_values=-1)
    square = np.zeros(shown.shape, dtype=bool)
    top, left = row + side - side // 2, column + side - side // 2
    square[top : top + side, left : left + side] = True
    counts = np.bincount(shown[square] + 1, minlength=3)[1:]
    other, most = np.sort(counts)[-2:]
    if most < _MOST * side**2 or other >= _OTHER * side**2:
        return None
    patch, _ = cut_patch(np.pad(rgb, ((side, side), (side, side), (0, 0))), square)
    return patch, int(counts.argmax()), int(most)
