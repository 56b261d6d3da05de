"""Rows of a large array as tensors: all in memory if they fit there, else read when they are asked for."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# Memory for the rows of one array [bytes]: 1,900 pictures of 512 x 512 pixels, or 270 of 1408 x 1408.
IN_MEMORY = 1_610_612_736


class StoredRows:
    """(V, ...) array of which the first rows are in memory and the others are read at each access.

    Attributes:
        shape: as of a tensor.
    """

    def __init__(self, held: Tensor, shape: tuple[int, ...], read: Callable[[int], NDArray]) -> None:
        """Take the ``held`` first rows, the shape of all, and a function that reads a row by its position."""
        self.shape = shape
        self._held, self._read = held, read

    def __getitem__(self, position: int) -> Tensor:
        """One row on the CPU."""
        if position < len(self._held):
            return self._held[position]
        return torch.from_numpy(np.array(self._read(position)))


def stored_rows(
    count: int, shape: tuple[int, ...], dtype: str, read: Callable[[int], NDArray]
) -> Tensor | StoredRows:
    """Return a (count, *shape) CPU tensor, or ``StoredRows`` if it would take more than ``IN_MEMORY`` bytes.

    Args:
        read: returns the row at a position, with this shape and dtype; it is kept if not all rows fit.
    """
    row_bytes = np.dtype(dtype).itemsize * int(np.prod(shape))
    kept = min(count, IN_MEMORY // max(row_bytes, 1))
    rows = np.empty((kept, *shape), dtype)
    for position in range(kept):
        rows[position] = read(position)
    held = torch.from_numpy(rows)
    # Views are visited in random order, once an epoch: which rows are held does not matter.
    return held if kept == count else StoredRows(held, (count, *shape), read)
