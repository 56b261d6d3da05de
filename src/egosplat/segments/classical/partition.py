"""A picture cut into nested regions."""

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.classical.graph import make_graph
from egosplat.segments.classical.merging import merge_levels
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.working_image import check_picture, enlarge, make_working


def partition(
    picture: NDArray[np.uint8], valid: NDArray[np.bool_], options: ClassicalOptions
) -> NDArray[np.int32]:
    """(4, H, W) int32 fine regions, subparts, parts and wholes of a picture; -1 outside of ``valid``.

    Args and errors: see ``egosplat.segments.classical.segment``.
    """
    check_picture(picture, valid)
    if not valid.any():
        return np.full((4, *valid.shape), -1, dtype=np.int32)
    working = make_working(picture, valid, options.side)
    graph = make_graph(working, options)
    levels = merge_levels(graph, working.unit, options)
    return np.where(valid, enlarge(levels[:, graph.labels], working.shape), np.int32(-1))
