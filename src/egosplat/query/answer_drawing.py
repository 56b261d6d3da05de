"""Draw an answer over the rendered view: relevancy as a heat map, and the mask."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

# Brightness of pixels outside the mask.
DIMMED = 0.35

# Opacity of the heat map.
HEAT = 0.65

# Word, marker and color of a hit and of a miss.
HIT, MISS = ("hit", "o", "forestgreen"), ("miss", "X", "red")


def draw_heat(axes: Axes, picture: NDArray[np.float32], relevancy: NDArray[np.float32]) -> None:
    """Draw an (H, W) relevancy in 0..1 over the (H, W, 3) view in 0..1, shown in gray."""
    axes.imshow(picture.mean(axis=-1), cmap="gray", vmin=0.0, vmax=1.0)
    axes.imshow(relevancy, cmap="turbo", vmin=0.0, vmax=1.0, alpha=HEAT)


def draw_mask(axes: Axes, picture: NDArray[np.float32], mask: NDArray[np.bool_]) -> None:
    """Draw the (H, W, 3) view in 0..1, dimmed outside the (H, W) mask."""
    axes.imshow(np.where(mask[..., None], picture, DIMMED * picture))


def draw_outline(axes: Axes, mask: NDArray[np.bool_]) -> None:
    """Draw the outline of an (H, W) mask in white on black."""
    if mask.any() and not mask.all():
        axes.contour(mask, levels=[0.5], colors="black", linewidths=1.8)
        axes.contour(mask, levels=[0.5], colors="white", linewidths=0.9)
