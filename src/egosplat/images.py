"""Images: resize them, measure how sharp they are, encode them for pages, and choose a few of many."""

import cv2
import numpy as np
from numpy.typing import NDArray

# Largest width and height of a WebP file [px].
LARGEST = 16383

# Sharpness: fine detail relative to the contrast of the same edges at a coarser scale.
# Scale at which an edge's contrast is measured: blur of a few pixels hardly changes it [px].
_COARSE = 2.0
# Edges are the pixels with the largest contrast, and noise is measured at those with less than the median.
_EDGES, _FLAT = 0.9, 0.5
# Fainter edges tell nothing [gray levels from pixel to pixel].
_MIN_CONTRAST = 1.0
# Detail that drowns in noise counts as this fraction of the contrast.
_MIN_DETAIL = 0.01
# Median absolute deviation of a normal distribution to its standard deviation.
_SIGMA_OF_MAD = 1.4826
# Pixels that the filters reach beyond a pixel: eight of the Gaussian, and one of the difference.
_REACH = 9
_MIN_PIXELS = 100

# The smoothed image is in this fraction of a gray level.
_UNIT = 256

_Integers = NDArray[np.int32]


def shrunk_size(width: int, height: int, longest: int | None) -> tuple[int, int]:
    """Return width and height in the same proportion, the longer one at most ``longest``; as they are for None."""
    scale = 1.0 if longest is None else min(1.0, longest / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def resize_image(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 -> (height, width, 3) uint8, averaged over the area of each new pixel; the same array if nothing changes."""
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), image.dtype)


def shrink_image(image: NDArray[np.uint8], longest: int | None) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 -> the same image in the size of ``shrunk_size``."""
    height, width = image.shape[:2]
    return resize_image(image, *shrunk_size(width, height, longest))


def resize_mask(mask: NDArray[np.bool_], width: int, height: int) -> NDArray[np.bool_]:
    """(h, w) bool -> (height, width) bool: True where the whole area of the new pixel is in the mask."""
    coverage = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    # 1 up to float32 rounding.
    return coverage > 1 - 1e-4


def resize_labels(labels: NDArray[np.generic], width: int, height: int) -> NDArray[np.generic]:
    """(..., h, w) -> (..., height, width): the label under the center of each new pixel."""
    # The source pixel of center i + 1/2 in integer arithmetic, without rounding.
    rows = (2 * np.arange(height) + 1) * labels.shape[-2] // (2 * height)
    columns = (2 * np.arange(width) + 1) * labels.shape[-1] // (2 * width)
    return labels[..., rows[:, None], columns]


def measure_sharpness(image: NDArray[np.uint8], valid: NDArray[np.bool_]) -> float:
    """Logarithm of the energy of fine detail at edges, relative to the edges' contrast; NaN if there are no edges.

    The mean over four directions, because motion blurs one direction only. A motion of 2 px during the exposure lowers it
    by 0.7, of 4 px by 1.4. Brightness and contrast do not change it, and noise is subtracted.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool: pixels that show the scene.
    """
    kernel = np.ones((2 * _REACH + 1, 2 * _REACH + 1), np.uint8)
    inside = cv2.erode(valid.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    if inside.sum() < _MIN_PIXELS:
        return float("nan")
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # Integers, so that the result does not depend on the processor: OpenCV blurs 16 bits in fixed point.
    coarse = cv2.GaussianBlur(gray.astype(np.uint16) * _UNIT, (0, 0), _COARSE).astype(np.int32)
    fine = gray.astype(np.int32)
    return float(np.mean([_detail(fine, coarse, inside, step) for step in ((0, 1), (1, 0), (1, 1), (1, -1))]))


def _detail(gray: _Integers, coarse: _Integers, inside: NDArray[np.bool_], step: tuple[int, int]) -> float:
    """``measure_sharpness`` in one direction."""
    contrast = np.abs(_shifted(coarse, step, 1) - coarse)[inside]
    # The second difference: zero where brightness changes evenly.
    fine = np.abs(_shifted(gray, step, 1) + _shifted(gray, step, -1) - 2 * gray)[inside]
    flat, edge = np.quantile(contrast, (_FLAT, _EDGES))
    at_edges = contrast >= edge
    energy = _mean_square(contrast[at_edges]) / _UNIT**2
    if energy < _MIN_CONTRAST**2:
        return float("nan")
    noise = (_SIGMA_OF_MAD * float(np.median(fine[contrast <= flat]))) ** 2
    return float(np.log(max((_mean_square(fine[at_edges]) - noise) / energy, _MIN_DETAIL)))


def _mean_square(values: _Integers) -> float:
    return int(np.square(values, dtype=np.int64).sum()) / len(values)


def _shifted(image: _Integers, step: tuple[int, int], count: int) -> _Integers:
    """The image whose pixel p is pixel p + count * step of ``image``; rows and columns wrap around."""
    return np.roll(image, (-count * step[0], -count * step[1]), axis=(0, 1))


def encode_webp(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 RGB, at most ``LARGEST`` px wide and high -> (n,) uint8, the bytes of a WebP file."""
    _, file = cv2.imencode(".webp", image[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    return file.reshape(-1)


def evenly_spaced(count: int, most: int) -> list[int]:
    """At most ``most`` indices below ``count``, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()
