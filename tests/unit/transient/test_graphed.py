"""On a GPU, H is a CUDA graph: the same probabilities, gradients and running statistics."""

import copy

import pytest
import torch
from torch import nn

from egosplat.transient.graphed import graphed
from egosplat.transient.network import make_network

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


def test_the_graph_computes_what_the_network_computes():
    """The second picture shows that the graph reads its input, and the changed weights that it reads these."""
    noise = torch.Generator().manual_seed(0)
    net = make_network(64, sideways=False, encoder_weights=None, seed=0).cuda().train()
    other = copy.deepcopy(net)
    pictures = [torch.rand(24, 32, 3, generator=noise).cuda() for _ in range(2)]
    with torch.backends.cudnn.flags(deterministic=True, allow_tf32=False):
        call = graphed(net, pictures[0])
        for picture in pictures:
            found, wanted = call(picture), other(picture, 24, 32)
            torch.testing.assert_close(found, wanted, rtol=1e-3, atol=1e-4)
            gradients = [_gradients(*each) for each in ((net, found), (other, wanted))]
            torch.testing.assert_close(*gradients, rtol=1e-2, atol=1e-4)
            with torch.no_grad():
                for weight in net.parameters():
                    weight += 0.1
            for mine, wanted in zip(net.buffers(), other.buffers(), strict=True):
                torch.testing.assert_close(mine, wanted, rtol=1e-3, atol=1e-5)
            other.load_state_dict(net.state_dict())


def _gradients(net: nn.Module, probability: torch.Tensor) -> list[torch.Tensor]:
    """The gradient of each weight, in units of its largest value."""
    found = torch.autograd.grad(probability.square().mean(), [*net.parameters()], allow_unused=True)
    return [each / each.abs().max().clamp_min(1e-6) for each in found if each is not None]
