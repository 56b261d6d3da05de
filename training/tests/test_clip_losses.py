"""The losses follow their definitions on small numbers."""

import pytest
import torch
from torch.nn import functional as F

from training.small_models.clip_losses import contrastive_loss, neutral_loss, synonym_loss


def test_with_one_true_caption_each_the_loss_is_symmetric_cross_entropy() -> None:
    logits = torch.randn(5, 5, generator=torch.Generator().manual_seed(0))
    truth, target = torch.eye(5, dtype=torch.int8), torch.arange(5)
    expected = F.cross_entropy(logits, target) + F.cross_entropy(logits.T, target)
    torch.testing.assert_close(contrastive_loss(logits, truth, torch.ones(5)), expected)


def test_other_true_captions_and_undecided_ones_do_not_compete() -> None:
    truth = torch.tensor([[1, 1, 0, -1], [0, 0, 1, -1]], dtype=torch.int8)
    logits = torch.tensor([[1.0, 9.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]], requires_grad=True)
    changed = logits.detach().clone()
    changed[:, 3] = 100.0
    weights = torch.ones(4)
    loss = contrastive_loss(logits, truth, weights)
    torch.testing.assert_close(loss, contrastive_loss(changed, truth, weights))
    loss.backward()
    assert (logits.grad[:, 3] == 0).all()
    # The first caption is true of the first crop and is pulled to it although the second one is nearer.
    assert logits.grad[0, 0] < 0


@pytest.mark.parametrize(("cosine", "sign"), [(0.95, 1), (0.0, -1)])
def test_canonical_phrases_are_drawn_between_true_and_false(cosine: float, sign: int) -> None:
    canonical = torch.tensor([[cosine]], requires_grad=True)
    truth = torch.tensor([[1, 0]], dtype=torch.int8)
    neutral_loss(torch.tensor([[0.8, 0.1]]), canonical, truth, 0.1, 20.0).backward()
    assert torch.sign(canonical.grad[0, 0]) == sign


def test_only_words_move_to_their_meaning() -> None:
    meanings = torch.eye(3, requires_grad=True)
    words = F.normalize(torch.tensor([[1.0, 0.5, 0.0]]), dim=1).requires_grad_()
    target = torch.tensor([1])
    loss = synonym_loss(words, meanings, target, 10.0)
    loss.backward()
    assert meanings.grad is None
    moved = F.normalize(words - 0.1 * words.grad, dim=1).detach()
    assert moved[0, 1] > words[0, 1]
    assert synonym_loss(meanings.detach()[target], meanings, target, 10.0) < loss
