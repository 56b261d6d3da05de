"""On a GPU, H is a CUDA graph: the same probabilities, gradients and running statistics."""

import copy

import pytest
import torch

from egosplat.transient.graphed import graphed
from egosplat.transient.network import make_network

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


def test_the_graph_computes_what_the_network_computes():
    """The second picture shows that the graph reads its input, and changed weights that it reads these."""
    noise = torch.Generator().manual_seed(0)
    net = make_network(64, sideways=False, encoder_weights=None, seed=0).cuda().train()
    other = copy.deepcopy(net)
    pictures = [torch.rand(24, 32, 3, generator=noise).cuda() for _ in range(2)]
    call = graphed(net, pictures[0])
    for picture in pictures:
        found, wanted = call(picture), other(picture, 24, 32)
        torch.testing.assert_close(found, wanted, rtol=1e-3, atol=1e-4)
        for one in (found, wanted):
            one.square().mean().backward()
        for one in (net, other):
            with torch.no_grad():
                for weight in one.parameters():
                    weight -= 1e-3 * weight.grad.sign()
                    weight.grad = None
    for name, value in other.state_dict().items():
        # Where a gradient is nearly 0, rounding decides its sign.
        torch.testing.assert_close(net.state_dict()[name], value, rtol=1e-2, atol=5e-3)
