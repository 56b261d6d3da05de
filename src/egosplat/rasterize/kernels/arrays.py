"""Tensors as the compiled kernels take them."""

from torch import Tensor


def plain(tensor: Tensor | None) -> Tensor | None:
    """The numbers of a tensor, contiguous and without gradients; None stays None."""
    return None if tensor is None else tensor.detach().contiguous()


def address(tensor: Tensor | None) -> int | None:
    """Address of the first number; None, the null pointer, stays None."""
    return None if tensor is None else tensor.data_ptr()
