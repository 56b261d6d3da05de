"""Describe the arrays of an artifact."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from egosplat.artifacts.values import FINITE, Values


@dataclass(frozen=True)
class Field:
    """One array of an artifact.

    Attributes:
        dims: name of each axis, or its fixed size. Axes with the same name have the same size within an artifact.
        dtype: NumPy name of the element type.
        unit: physical unit, or what the numbers count.
        by_row: number of rows (indices of the first axis) in a chunk: ``True`` (one) for arrays that are read frame by
            frame, a number that gives chunks of a few MB for many short rows, ``False`` for all rows.
        optional: whether an artifact may lack it.
        values: the numbers that it may hold.
    """

    dims: tuple[str | int, ...]
    dtype: str
    unit: str
    about: str
    by_row: int = False
    optional: bool = False
    values: Values = FINITE


@dataclass(frozen=True)
class Schema:
    """The arrays of one kind of artifact. ``version`` grows when old artifacts can no longer be read."""

    name: str
    version: int
    fields: Mapping[str, Field] = field(default_factory=dict)


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
