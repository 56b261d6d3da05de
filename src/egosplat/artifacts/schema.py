"""Describe the arrays of an artifact, and which numbers each may hold: its writer and its reader check it."""

import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import is_rigid

_LARGEST = sys.float_info.max


@dataclass(frozen=True)
class Values:
    """The numbers that an array may hold: from ``least`` to ``most``, finite by default, and ``nan`` for what is not known.

    Attributes:
        below: the numbers are indices along this axis of the artifact, or of this fact, which is a list.
        form: what the last axes are together, in words, and its test: array -> (...) bool.
    """

    least: float = -_LARGEST
    most: float = _LARGEST
    nan: bool = False
    below: str | None = None
    form: tuple[str, Callable[[NDArray[Any]], NDArray[np.bool_]]] | None = None

    def limits(self, dtype: Any) -> bool:
        """Whether an array of this element type can hold a number that is not allowed."""
        return self != ANY and (np.dtype(dtype).kind == "f" or self != FINITE)

    def find_fault(self, values: NDArray[Any], sizes: Mapping[str, int]) -> str:
        """What is wrong with ``values``; empty if nothing is. Indices along an axis not in ``sizes`` have no upper limit."""
        if not values.size or not self.limits(values.dtype):
            return ""
        most = self.most if self.below is None else min(self.most, sizes.get(self.below, math.inf) - 1)
        # Two reductions need no memory and are several times as fast as a test of each number. NaN compares as false.
        lowest, highest = (np.fmin, np.fmax) if self.nan else (np.minimum, np.maximum)
        low, high = (each.reduce(values, axis=None).item() for each in (lowest, highest))
        if not ((low >= self.least and high <= most) or (self.nan and math.isnan(low))):
            numbers = values.astype(np.float64)
            bad = ~((numbers >= self.least) & (numbers <= most)) & ~(self.nan & np.isnan(numbers))
            count = f"{np.sum(bad):,} of {bad.size:,} numbers are not"
            return f"must be {self._range(most)}, and {count}, such as {values[bad][0]:g}"
        if self.form is not None and not (good := self.form[1](values)).all():
            return f"must be {self.form[0]}, and {np.sum(~good):,} of {np.size(good):,} are not"
        return ""

    def _range(self, most: float) -> str:
        if most < _LARGEST:
            told = f"in {self.least:g}..{most:g}"
        else:
            told = "finite" if self.least == -_LARGEST else f"at least {self.least:g} and finite"
        return f"{told}, or NaN" if self.nan else told


def _is_pinhole(matrix: NDArray[Any]) -> NDArray[np.bool_]:
    """() bool: focal lengths are positive, without skew."""
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    expected = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return np.asarray((matrix == expected).all() and min(fx, fy) > 0)


FINITE, SHARE = Values(), Values(least=0, most=1)
# For features that the next stage skips with a warning, losses of skipped steps, and the PSNR of equal pictures.
ANY = Values(least=-np.inf, most=np.inf, nan=True)

# The words for them in a table.
_KINDS = {
    "any": ANY,
    "finite or nan": Values(nan=True),
    "count": Values(least=0),
    "count or -1": Values(least=-1),
    "share": SHARE,
    "share or nan": Values(least=0, most=1, nan=True),
    "scale or nan": Values(least=0, nan=True),
    "pinhole": Values(form=("a pinhole matrix with positive focal lengths", _is_pinhole)),
    "poses or nan": Values(
        nan=True,
        form=("rigid motions, or NaN throughout", lambda each: is_rigid(each) | np.isnan(each).all((-1, -2))),
    ),
    "unit vector": Values(
        form=("a unit vector", lambda each: abs(np.linalg.norm(each, axis=-1) - 1.0) <= 1e-6)
    ),
}


@dataclass(frozen=True)
class Field:
    """One array of an artifact, which may lack it if it is ``optional``.

    Attributes:
        array: element type, then name or fixed size of each axis, as in ``float64 frame 4 4``; axes of one name have one size.
        unit: physical unit, or what the numbers count.
        by_row: rows in a chunk: 1 for arrays that are read frame by frame, more for many short rows, 0 for all rows.
    """

    array: str
    unit: str
    about: str
    values: Values = FINITE
    by_row: int = 0
    optional: bool = False

    @property
    def dtype(self) -> str:
        return self.array.split()[0]

    @property
    def dims(self) -> tuple[str | int, ...]:
        return tuple(int(word) if word.isdigit() else word for word in self.array.split()[1:])


@dataclass(frozen=True)
class Schema:
    """The arrays of one kind of artifact. ``version`` grows when old artifacts can no longer be read."""

    name: str
    version: int
    fields: Mapping[str, Field]


def read_table(name: str) -> Schema:
    """Read a schema from its table, ``tables/NAME.txt``.

    The first line has name and version, each other one an array: ``name | type and axes, rules | unit | about``, and what is
    indented below it continues it. A rule is a kind of values, ``index of AXIS``, ``-1 or index of AXIS``,
    ``from N to N``, ``by row``, ``by N rows`` or ``optional``, as in ``Values`` and ``Field``.
    """
    text = (Path(__file__).with_name("tables") / f"{name}.txt").read_text(encoding="utf-8")
    first, *rows = re.sub(r"\n +", " ", text.strip()).splitlines()
    version = first.split()[-1]
    cells = ([cell.strip() for cell in row.split(" | ")] for row in rows)
    return Schema(name, int(version), {row[0]: _read_field(*row[1:]) for row in cells})


def _read_field(array: str, unit: str, about: str) -> Field:
    array, *rules = array.split(", ")
    settings: dict[str, Any] = {}
    for rule in rules:
        match rule.split():
            case ["optional"]:
                settings["optional"] = True
            case ["by", *words]:
                settings["by_row"] = int(words[0]) if len(words) > 1 else 1
            case [*none, "index", "of", axis]:
                settings["values"] = Values(least=-1 if none else 0, below=axis)
            case ["from", least, "to", most]:
                settings["values"] = Values(least=int(least), most=int(most))
            case _:
                settings["values"] = _KINDS[rule]
    return Field(array, unit, about, **settings)


def check_shape(declared: Field, shape: tuple[int, ...], sizes: dict[str, int], name: str) -> None:
    """Check ``shape`` against the declared axes and the known ``sizes``, and add new sizes to them."""
    if len(shape) != len(declared.dims):
        raise ValueError(f"{name!r} has {len(shape)} axes, not {len(declared.dims)}")
    for dim, size in zip(declared.dims, shape, strict=True):
        expected = dim if isinstance(dim, int) else sizes.setdefault(dim, size)
        if size != expected:
            raise ValueError(f"{name!r} has size {size} along axis {dim!r}, not {expected}")


def sizes_of(axes: Mapping[str, int], facts: Mapping[str, Any]) -> dict[str, int]:
    """Sizes that bound indices: of the axes, and of the facts that are lists."""
    return {name: len(fact) for name, fact in facts.items() if isinstance(fact, list)} | dict(axes)
