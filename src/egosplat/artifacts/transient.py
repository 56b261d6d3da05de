"""Schema of ``transient.zarr``: the probability that a pixel is transient, and its mean over instances."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import ANY, COUNT, SCALE_OR_UNKNOWN, SHARE, SHARE_OR_UNKNOWN

TRANSIENT = Schema(
    "transient",
    2,
    {
        "probability": Field(
            ("frame", "height", "width"),
            "float16",
            "0..1",
            "the network's probability that the pixel is of something transient, of frames without a pose too",
            by_row=True,
            values=SHARE,
        ),
        "stands_out": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "pixels whose squared difference to the temporary Gaussians after the warm-up exceeds 3.5 medians of their frame; "
            "false in frames without residual_scale",
            by_row=True,
        ),
        "compared": Field(
            ("height", "width"), "bool", "-", "pixels that stands_out speaks of: inside the lens circle"
        ),
        "residual_scale": Field(
            ("frame",),
            "float32",
            "squared sRGB in 0..1",
            "median squared difference of the frame to the temporary Gaussians after the warm-up; NaN if it was not measured: "
            "not trained on, or penalty_unit is absolute",
            values=SCALE_OR_UNKNOWN,
        ),
        "weights": Field(
            ("number",), "float32", "-", "the network's tensors, flat, one after the other; facts name them"
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record", values=COUNT
        ),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before", values=ANY
        ),
        "curve/probability": Field(
            ("record",),
            "float64",
            "0..1",
            "mean probability in the same iterations; 0 in the warm-up",
            values=SHARE_OR_UNKNOWN,
        ),
    },
)


class InstanceScores:
    """Mean probability of each of N instances over its pixels in all added frames, as in the paper's set D."""

    def __init__(self, count: int) -> None:
        """Start without frames; ``count`` is the number of instances N."""
        self._sums = np.zeros(count)
        self._pixels = np.zeros(count, np.int64)

    def add(self, labels: NDArray[np.int32], probability: NDArray[np.floating]) -> None:
        """Add a frame: (L, H, W) instance at each level, -1 for none, and (H, W) probability in [0, 1]."""
        # float64: sums over all frames of a video exceed the digits of float16 and float32.
        weight = probability.astype(np.float64)
        for level in labels:
            seen = level >= 0
            found = level[seen]
            self._pixels += np.bincount(found, minlength=len(self._pixels))
            self._sums += np.bincount(found, weights=weight[seen], minlength=len(self._sums))

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(N,) number of pixels of each instance in the added frames."""
        return self._pixels.copy()

    @property
    def scores(self) -> NDArray[np.float64]:
        """(N,) mean probability of each instance; 0 if it has no pixel."""
        # Pooled over pixels, so a large view of an instance has more weight than a small one.
        return np.divide(self._sums, self._pixels, out=np.zeros_like(self._sums), where=self._pixels > 0)
