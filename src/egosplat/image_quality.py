"""PSNR and SSIM between a render and a photograph over valid pixels.

Evaluation during training and the ``metrics`` stage share these definitions. Invalid pixels (outside the lens circle)
count in neither score:

- PSNR is over the valid pixels of a region.
- SSIM is the mean of the SSIM map over pixels whose whole 11 x 11 window lies inside the image and the valid region.
  Filling the windows that reach beyond would raise the score, with equal pixels as with a truncated window. Without
  invalid pixels this is the SSIM of Wang et al. (2004); torchmetrics has the same map, but mirrors the image at its
  border.

LPIPS is left out: it needs the weights of a network that are not shipped.
"""

import math

import torch
from torch import Tensor
from torch.nn import functional

# Radius of SSIM's 11 x 11 window [px].
WINDOW_RADIUS = 5

# Constants of Wang et al. (2004): Gaussian window, (K1 L)^2 and (K2 L)^2 with L = 1.
_SIGMA = 1.5
_C1, _C2 = 0.01**2, 0.03**2
_MAX_VALUE = 255


def psnr(render: Tensor, photograph: Tensor, region: Tensor) -> float:
    """PSNR of (H, W, 3) uint8 images over a region, (H, W) bool [dB]; infinite for equal images, NaN for an empty region."""
    difference = render[region].long() - photograph[region].long()
    count, error = difference.numel(), int(difference.square().sum())
    if not count:
        return math.nan
    return 10.0 * math.log10(_MAX_VALUE**2 * count / error) if error else math.inf


def ssim_map(render: Tensor, photograph: Tensor, valid: Tensor) -> Tensor:
    """SSIM of each pixel of (H, W, 3) uint8 images, averaged over the channels: (H, W) float32, at most 1.

    It is NaN where the window reaches outside the image or the ``valid`` pixels, (H, W) bool.
    """
    values = torch.full(valid.shape, math.nan, device=valid.device)
    height, width = valid.shape
    if min(height, width) <= 2 * WINDOW_RADIUS:
        return values
    x, y = render.float() / _MAX_VALUE, photograph.float() / _MAX_VALUE
    invalid = (~valid).float()[None, None]
    reached = functional.max_pool2d(invalid, 2 * WINDOW_RADIUS + 1, stride=1)[0, 0] > 0
    inner = structural_similarity(x, y, padding=0).mean(dim=-1)
    values[WINDOW_RADIUS:-WINDOW_RADIUS, WINDOW_RADIUS:-WINDOW_RADIUS] = inner.masked_fill(reached, math.nan)
    return values


def mean_ssim(values: Tensor, region: Tensor) -> float:
    """Mean of the (H, W) values of ``ssim_map`` over the pixels of a region that have one; NaN if none has."""
    values = values[region].double()
    return float(values[~values.isnan()].mean())


def structural_similarity(x: Tensor, y: Tensor, padding: int) -> Tensor:
    """SSIM of each pixel and channel (Wang et al. 2004) of (H, W, C) floating point images, 0 to 1.

    ``padding`` is the width of the border of zeros [px]: 0 gives a map of whole windows, (H - 10, W - 10, C), and
    ``WINDOW_RADIUS`` one of the image's size, as in 3DGS's loss.
    """
    x, y = x.permute(2, 0, 1), y.permute(2, 0, 1)
    mean_x, mean_y, mean_xx, mean_yy, mean_xy = _blur(torch.stack([x, y, x * x, y * y, x * y]), padding)
    variances = (mean_xx - mean_x**2) + (mean_yy - mean_y**2)
    covariance = mean_xy - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    return (luminance * (2 * covariance + _C2) / (variances + _C2)).permute(1, 2, 0)


def _blur(images: Tensor, padding: int) -> Tensor:
    """(..., H, W) images filtered with SSIM's window."""
    taps = [math.exp(-0.5 * (i / _SIGMA) ** 2) for i in range(-WINDOW_RADIUS, WINDOW_RADIUS + 1)]
    window = images.new_tensor(taps) / sum(taps)
    # Images as channels: as a batch of single-channel images, torch takes ten times as long on the CPU.
    channels = images.flatten(end_dim=-3)[None]
    count = channels.shape[1]
    along_rows = window.expand(count, 1, 1, -1)
    rows = functional.conv2d(channels, along_rows, padding=(0, padding), groups=count)
    blurred = functional.conv2d(rows, along_rows.mT, padding=(padding, 0), groups=count)
    return blurred.view(*images.shape[:-2], *blurred.shape[-2:])
