"""How well a render shows a photograph: PSNR and SSIM over the pixels that are valid.

The only definition of both scores; training's evaluation and the benchmark use it. A pixel is valid where it shows the
scene, inside the lens circle. Invalid pixels count in neither score:

- PSNR is over the valid pixels (of a region, over the region's).
- SSIM is the mean of the SSIM map over the pixels whose whole window of 11 x 11 lies inside the picture and inside what
  is valid. A window that reached beyond would have to be filled: with equal pixels, which raises the score, or with a
  part of the Gaussian, whose variances come from so few pixels that they are lower, which raises it too. Where all
  pixels are valid this is Wang et al.'s (2004) own SSIM; torchmetrics has the same map there, and mirrors the picture
  at its border, which is left out here.

LPIPS is left out: it needs the weights of a network that are not shipped.
"""

import math

import torch
from torch import Tensor
from torch.nn import functional

REACH = 5
"""Pixels from the middle of SSIM's window to its edge."""

_SIGMA = 1.5
_C1, _C2 = 0.01**2, 0.03**2
_LARGEST = 255


def psnr(render: Tensor, photograph: Tensor, region: Tensor) -> float:
    """PSNR over the pixels of a region.

    Args:
        render, photograph: (H, W, 3) uint8.
        region: (H, W) bool; all of it valid.

    Returns:
        [dB]; infinite where both are equal there, NaN where the region is empty.
    """
    difference = render[region].long() - photograph[region].long()
    count, error = difference.numel(), int(difference.square().sum())
    if not count:
        return math.nan
    return 10.0 * math.log10(_LARGEST**2 * count / error) if error else math.inf


def similarity(render: Tensor, photograph: Tensor, valid: Tensor) -> Tensor:
    """The SSIM map, the mean over the channels.

    Args:
        render, photograph: (H, W, 3) uint8.
        valid: (H, W) bool.

    Returns:
        (H, W) float32, at most 1; NaN where the window does not lie wholly inside the picture and what is valid.
    """
    whole = torch.full(valid.shape, math.nan, device=valid.device)
    height, width = valid.shape
    if min(height, width) <= 2 * REACH:
        return whole
    x, y = render.float() / _LARGEST, photograph.float() / _LARGEST
    invalid = (~valid).float()[None, None]
    reached = functional.max_pool2d(invalid, 2 * REACH + 1, stride=1)[0, 0] > 0
    inner = structural_similarity(x, y, padding=0).mean(dim=-1)
    whole[REACH:-REACH, REACH:-REACH] = inner.masked_fill(reached, math.nan)
    return whole


def mean_similarity(similarity: Tensor, region: Tensor) -> float:
    """Mean of an SSIM map over the pixels of a region that have a value; NaN where none has.

    Args:
        similarity: (H, W), see ``similarity``.
        region: (H, W) bool.
    """
    values = similarity[region].double()
    return float(values[~values.isnan()].mean())


def structural_similarity(x: Tensor, y: Tensor, padding: int) -> Tensor:
    """SSIM of each value's surroundings (Wang et al. 2004): Gaussian window of 11 x 11 pixels and standard deviation
    1.5 px, K1 = 0.01, K2 = 0.03, data range 1; each channel by itself.

    Args:
        x, y: (H, W, C) floating point.
        padding: pixels of 0 around the picture. With 0 the windows lie wholly inside it, and the map is 10 px smaller
            on a side; with ``REACH`` it has the picture's size, as in 3DGS's loss.

    Returns:
        (H, W, C), or (H - 10, W - 10, C).
    """
    x, y = x.permute(2, 0, 1), y.permute(2, 0, 1)
    mean_x, mean_y, mean_xx, mean_yy, mean_xy = _blur(torch.stack([x, y, x * x, y * y, x * y]), padding)
    variances = (mean_xx - mean_x**2) + (mean_yy - mean_y**2)
    covariance = mean_xy - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    return (luminance * (2 * covariance + _C2) / (variances + _C2)).permute(1, 2, 0)


def _blur(images: Tensor, padding: int) -> Tensor:
    """(..., H, W) under the window of SSIM."""
    taps = [math.exp(-0.5 * (i / _SIGMA) ** 2) for i in range(-REACH, REACH + 1)]
    window = images.new_tensor(taps) / sum(taps)
    # Every image is a channel of its own: as images of one channel each, torch takes ten times as long on the CPU.
    channels = images.flatten(end_dim=-3)[None]
    count = channels.shape[1]
    along_rows = window.expand(count, 1, 1, -1)
    rows = functional.conv2d(channels, along_rows, padding=(0, padding), groups=count)
    blurred = functional.conv2d(rows, along_rows.mT, padding=(padding, 0), groups=count)
    return blurred.view(*images.shape[:-2], *blurred.shape[-2:])
