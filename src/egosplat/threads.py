"""How many threads PyTorch computes with."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """PyTorch and the kernels compute with one thread here.

    oneDNN's gradients of convolutions over one pixel are not the same each time with more, whatever
    ``torch.backends.mkldnn.deterministic`` is.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
