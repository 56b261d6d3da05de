"""Long recordings are trained without holding all pictures, with the same result."""

import numpy as np
import pytest
import torch

from egosplat.gaussians import training_views as module
from egosplat.gaussians.training_views import StoredRows, stored_rows


@pytest.mark.parametrize("kept", [0, 2, 5])
def test_rows_are_equal_whether_they_are_held_or_read(monkeypatch, kept):
    """Only rows beyond the limit are read again."""
    array = np.random.default_rng(0).integers(256, size=(5, 4, 3), dtype=np.uint8)
    monkeypatch.setattr(module, "IN_MEMORY", kept * 12)
    asked: list[int] = []

    def read(position: int) -> np.ndarray:
        asked.append(position)
        return array[position]

    rows = stored_rows(5, (4, 3), "uint8", read)
    assert asked == list(range(kept)) and isinstance(rows, StoredRows) == (kept < 5)
    assert tuple(rows.shape) == array.shape
    for position in range(5):
        assert torch.equal(rows[position], torch.from_numpy(array[position]))
    assert asked == [*range(kept), *range(kept, 5)]
