"""H as one CUDA graph: a GPU computes its many small layers faster than the CPU starts them one by one."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from egosplat.transient.network import TransientNet


class _OfSize(nn.Module):
    """H for pictures of one size; a graph takes tensors alone."""

    def __init__(self, net: TransientNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, picture: Tensor) -> Tensor:
        """(H, W) float32 probability of an (H, W, 3) picture."""
        return self.net(picture, *picture.shape[:2])


def graphed(net: TransientNet, picture: Tensor) -> Callable[[Tensor], Tensor]:
    """Capture ``net`` in training, forwards and backwards, for pictures like ``picture``; the network does not change.

    Args:
        net: on a CUDA device, in the mode train.
        picture: (H, W, 3) float32 on the same device.

    Returns:
        A function of pictures of this size. Its result holds until the next call. It follows changes of the weights in place.
    """
    # The capture has a stream of its own, so gradients reach the weights on another than that of the training.
    torch.autograd.graph.set_warn_on_accumulate_grad_stream_mismatch(False)
    before = [buffer.clone() for buffer in net.buffers()]
    call = torch.cuda.make_graphed_callables(_OfSize(net), (torch.zeros_like(picture),))
    # Trial runs before the capture have changed the running statistics.
    for buffer, kept in zip(net.buffers(), before, strict=True):
        buffer.copy_(kept)
    return call
