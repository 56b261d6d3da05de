"""Write what is carried from where to where, and when, as a table."""

import csv
from collections.abc import Iterable
from pathlib import Path

from egosplat.files import atomic_file
from egosplat.histories.told import Carried

# Seconds since the first frame, and places in the world.
COLUMNS = (
    *("name", "from_s", "until_s", "start_x", "start_y", "start_z", "end_x", "end_y", "end_z"),
    *("size", "frame"),
)


def write_table(carried: Iterable[tuple[str, Carried]], output: Path) -> None:
    """Write a row for each carry with its name."""
    with atomic_file(output) as scratch, scratch.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(_cells(*one) for one in carried)


def _cells(name: str, one: Carried) -> list[str]:
    """A row; a place that is not known is empty."""
    places = [
        cell
        for place, known in ((one.start, one.start_is_known), (one.end, one.end_is_known))
        for cell in ([f"{value:.6g}" for value in place] if known else [""] * 3)
    ]
    times = [f"{value:.3f}" for value in (one.from_s, one.until_s)]
    return [name, *times, *places, f"{one.size:.6g}", str(one.frame)]
