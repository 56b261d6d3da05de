"""An answer over the rendered view: its relevancy as a heat map, and its mask."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

DIMMED = 0.35
"""Brightness that is left of what is not in the mask."""

HEAT = 0.65
"""Share of the heat map's colours over the picture."""


def draw_heat(axes: Axes, picture: NDArray[np.float32], relevancy: NDArray[np.float32]) -> None:
    """Lay an (H, W) relevancy, 0 to 1, over the (H, W, 3) view, 0..1, in grey."""
    axes.imshow(picture.mean(axis=-1), cmap="gray", vmin=0.0, vmax=1.0)
    axes.imshow(relevancy, cmap="turbo", vmin=0.0, vmax=1.0, alpha=HEAT)


def draw_mask(axes: Axes, picture: NDArray[np.float32], mask: NDArray[np.bool_]) -> None:
    """Show the (H, W, 3) view, 0..1, dimmed where the (H, W) mask is not."""
    axes.imshow(np.where(mask[..., None], picture, DIMMED * picture))
