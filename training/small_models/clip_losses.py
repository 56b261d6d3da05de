"""What a small OpenCLIP is trained to: crops near the captions that are true of them, and words near synonyms."""

import torch
from torch import Tensor
from torch.nn import functional as F


def contrastive_loss(logits: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Contrastive loss with any number of positives, both ways.

    Each true pair competes with all false pairs of its crop, and with all of its caption: other captions that are
    true of a crop are no competitors.

    Args:
        logits: (B, T) scaled cosines of crops and captions.
        truth: (B, T): 1 true, 0 false, -1 neither.
        weights: (T,) how much each caption counts.
    """
    positive = (truth == 1).float() * weights
    return _one_way(logits, truth, positive, 1) + _one_way(logits, truth, positive, 0)


def _one_way(logits: Tensor, truth: Tensor, positive: Tensor, dim: int) -> Tensor:
    false = logits.masked_fill(truth != 0, -torch.inf).logsumexp(dim=dim, keepdim=True)
    # Where everything is true nothing competes.
    false = false.clamp(min=-1e4)
    each = (F.softplus(false - logits) * positive).sum(dim=dim) / positive.sum(dim=dim).clamp(min=1e-6)
    asked = positive.sum(dim=dim) > 0
    return each[asked].mean()


def neutral_loss(cosines: Tensor, canonical: Tensor, truth: Tensor, margin: float, scale: float) -> Tensor:
    """Canonical phrases ("object") are to be nearer than what is false of a crop, farther than what is true.

    Args:
        cosines: (B, T) of crops and captions; truth: (B, T) as in ``contrastive_loss``.
        canonical: (B, K) of crops and canonical phrases; margin: by which, at least; scale: of the cosines.
    """
    losses = []
    for sign, asked in ((1.0, truth == 1), (-1.0, truth == 0)):
        gap = sign * (canonical[:, :, None] - cosines[:, None])
        each = F.softplus(scale * (gap + margin))
        share = asked.float() / asked.sum(dim=1, keepdim=True).clamp(min=1)
        losses.append((each * share[:, None]).sum(dim=2).mean())
    return losses[0] + losses[1]


def synonym_loss(words: Tensor, meanings: Tensor, target: Tensor, scale: float) -> Tensor:
    """Words near the captions that mean the same; only the words are moved.

    Args:
        words: (G, D); meanings: (T, D), both of unit norm; target: (G,) the meaning of each word.
    """
    fixed = meanings.detach()
    return F.cross_entropy(scale * words @ fixed.T, target) + (1 - (words * fixed[target]).sum(dim=1)).mean()
