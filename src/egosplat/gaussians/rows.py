"""Rows that come and go, in Gaussians and their optimizer together."""

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam


def replace_rows(
    gaussians: Gaussians, optimizer: Adam, keep: Tensor, new: Gaussians | None = None
) -> Gaussians:
    """Keep the rows ``keep`` and append ``new`` with zero moments, in Gaussians and optimizer.

    Args:
        keep: (N,) bool.
        new: Gaussians to append.

    Returns:
        Leaves that require gradients, attached to ``optimizer``; ``gaussians`` itself if nothing changes.

    Raises:
        UserError: no Gaussian would be left.
    """
    added = new.count if new is not None else 0
    if not added and bool(keep.all()) and gaussians.count:
        return gaussians
    kept = gaussians.detach().select(keep)
    result = Gaussians.concatenate([kept, new.detach()]) if new is not None else kept
    if not result.count:
        raise UserError(
            f"splats: none of {gaussians.count} Gaussians is left to train: all were too transparent, too large "
            "or not finite; check the poses and the masks"
        )
    optimizer.select(keep)
    optimizer.append(added)
    result.requires_grad_()
    optimizer.attach(result)
    return result


def random_normal(like: Tensor, generator: torch.Generator) -> Tensor:
    """Sample standard normal numbers with the shape and device of ``like``; the generator is on the CPU.

    A GPU draws the numbers itself, from a seed that the generator draws: copying them would take longer than an
    iteration.
    """
    if like.device.type == "cuda":
        seed = int(torch.randint(2**62, (), generator=generator))
        generator = torch.Generator(like.device).manual_seed(seed)
    return torch.randn(like.shape, generator=generator, device=generator.device).to(like)
