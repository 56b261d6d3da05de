"""Choose a few of many."""

import numpy as np


def evenly_spaced(count: int, most: int) -> list[int]:
    """At most ``most`` indices below ``count``, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()
