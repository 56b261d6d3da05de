"""Numbers of threads."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import torch


@pytest.fixture
def with_threads() -> Iterator[Callable[..., Any]]:
    """``with_threads(count, function, *arguments)``: the result of a function with so many threads of torch."""
    before = torch.get_num_threads()

    def call(count: int, function: Callable[..., Any], *arguments: object) -> Any:
        torch.set_num_threads(count)
        return function(*arguments)

    yield call
    torch.set_num_threads(before)
