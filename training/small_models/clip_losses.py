"""Losses of the small OpenCLIP: crops close to their true captions, and words close to their synonyms."""

import torch
from torch import Tensor
from torch.nn import functional as F


def contrastive_loss(logits: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Symmetric contrastive loss with any number of positives.

    Each true pair competes with all false pairs of its crop, and with all false pairs of its caption. Other true
    captions of a crop do not compete.

    Args:
        logits: (B, T) scaled cosines of crops and captions.
        truth: (B, T): 1 true, 0 false, -1 undecided.
        weights: (T,) weight of each caption.
    """
    positive = (truth == 1).float() * weights
    return _one_way(logits, truth, positive, 1) + _one_way(logits, truth, positive, 0)


def _one_way(logits: Tensor, truth: Tensor, positive: Tensor, dim: int) -> Tensor:
    false = logits.masked_fill(truth != 0, -torch.inf).logsumexp(dim=dim, keepdim=True)
    # Without a false pair the sum is -inf, which would make the gradient NaN.
    false = false.clamp(min=-1e4)
    each = (F.softplus(false - logits) * positive).sum(dim=dim) / positive.sum(dim=dim).clamp(min=1e-6)
    asked = positive.sum(dim=dim) > 0
    return each[asked].mean()


def neutral_loss(cosines: Tensor, canonical: Tensor, truth: Tensor, margin: float, scale: float) -> Tensor:
    """Loss that places canonical phrases ("object") between the true and the false captions of a crop.

    Args:
        cosines: (B, T) of crops and captions; truth: (B, T) as in ``contrastive_loss``.
        canonical: (B, K) of crops and canonical phrases; margin: smallest difference; scale: of the cosines.
    """
    losses = []
    for sign, asked in ((1.0, truth == 1), (-1.0, truth == 0)):
        gap = sign * (canonical[:, :, None] - cosines[:, None])
        each = F.softplus(scale * (gap + margin))
        share = asked.float() / asked.sum(dim=1, keepdim=True).clamp(min=1)
        losses.append((each * share[:, None]).sum(dim=2).mean())
    return losses[0] + losses[1]


def synonym_loss(words: Tensor, meanings: Tensor, target: Tensor, scale: float) -> Tensor:
    """Loss that moves words to the captions with the same meaning; captions get no gradient.

    Args:
        words: (G, D); meanings: (T, D), both of unit norm; target: (G,) the meaning of each word.
    """
    fixed = meanings.detach()
    return F.cross_entropy(scale * words @ fixed.T, target) + (1 - (words * fixed[target]).sum(dim=1)).mean()
