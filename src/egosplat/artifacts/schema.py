"""How an artifact of one kind is described."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Field:
    """One array of an artifact.

    Attributes:
        dims: name of each axis, or its fixed size. Axes of one name have one size within an artifact.
        dtype: NumPy name of the element type.
        unit: physical unit, or what the numbers count.
        about: what the array holds, with its axis convention.
        by_row: how many indices of the first axis a chunk holds: ``True``, that is one, for what is read a frame
            at a time; a number, of which the chunks have a few MB, for many short rows; ``False`` for all.
    """

    dims: tuple[str | int, ...]
    dtype: str
    unit: str
    about: str
    by_row: int = False


@dataclass(frozen=True)
class Schema:
    """What an artifact of one kind holds. ``version`` grows when old artifacts can no longer be read."""

    name: str
    version: int
    fields: Mapping[str, Field] = field(default_factory=dict)


def check_shape(declared: Field, shape: tuple[int, ...], sizes: dict[str, int], name: str) -> None:
    """Check ``shape`` against the declared axes and the sizes seen so far, which it adds to."""
    if len(shape) != len(declared.dims):
        raise ValueError(f"{name!r} has {len(shape)} axes, not {len(declared.dims)}")
    for dim, size in zip(declared.dims, shape, strict=True):
        expected = dim if isinstance(dim, int) else sizes.setdefault(dim, size)
        if size != expected:
            raise ValueError(f"{name!r} has size {size} along axis {dim!r}, not {expected}")
