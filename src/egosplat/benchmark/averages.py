"""The mean of several scenes' scores, and how far it could be chance."""

import math
from collections.abc import Mapping, Sequence

from egosplat.benchmark.tables import Cell


def average(cells: Mapping[str, Cell]) -> Cell:
    """The plain mean over scenes, as in the paper's tables, of those that have a score.

    Its interval is that of a mean of independent values with intervals of their own (Zou and Donner 2008, "Construction
    of confidence limits about effect measures"): around the mean, the root of the sum of the squared distances of each
    bound from its value, divided by their number. It tells how far other queries could move the mean, not other scenes.

    Args:
        cells: by scene.

    Returns:
        The mean; without an interval where a scene has none.
    """
    there = {scene: cell for scene, cell in cells.items() if cell.percent is not None}
    if not there:
        return Cell()
    values = list(there.values())
    return Cell(
        percent=sum(cell.percent for cell in values) / len(values),
        interval=_interval(values),
        queries=sum(cell.queries or 0 for cell in values),
        scenes=tuple(sorted(there)),
    )


def _interval(cells: Sequence[Cell]) -> tuple[float, float] | None:
    if any(cell.interval is None for cell in cells):
        return None
    mean = sum(cell.percent for cell in cells) / len(cells)
    below = math.hypot(*(cell.percent - cell.interval[0] for cell in cells)) / len(cells)
    above = math.hypot(*(cell.interval[1] - cell.percent for cell in cells)) / len(cells)
    return mean - below, mean + above
