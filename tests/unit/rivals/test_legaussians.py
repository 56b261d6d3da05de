"""LEGaussians' codebook and losses against numbers worked out by hand."""

import math

import pytest
import torch

from egosplat_rivals.legaussians import (
    LEAST_SMOOTHING,
    MIXED,
    REGULARISER,
    WORDS,
    Codebook,
    even_use,
    mixture,
    smoothing,
    uncertain_loss,
)


def test_the_best_uncertainty_for_the_entropy_of_128_equal_words_and_of_a_certain_answer():
    entropy, u = torch.full((1,), math.log(128)), torch.tensor([0.7939], requires_grad=True)
    loss = uncertain_loss(entropy, u)
    loss.backward()
    assert float(loss.detach()) == pytest.approx(2.5794, abs=1e-4)
    assert float(u.grad) == pytest.approx(0.0, abs=1e-2)
    u = torch.tensor([0.3], requires_grad=True)
    uncertain_loss(torch.tensor([0.9]), u).backward()
    assert float(u.grad) > 0, "a certain answer wants none"
    assert math.isfinite(float(uncertain_loss(torch.ones(1), torch.ones(1))))


def test_even_use_of_all_words():
    likeness = torch.eye(WORDS) * 1e-6
    assert float(even_use(likeness)) == pytest.approx(1 / WORDS, rel=1e-4)
    assert float(even_use(torch.eye(WORDS)[:1].repeat(5, 1) * 50)) == pytest.approx(1.0, rel=1e-4)


def test_constant_tiles_mix_to_six_sevenths_and_the_largest_scale_has_no_influence():
    direction = torch.nn.functional.normalize(torch.randn(5), dim=0)
    tiles = [direction.repeat(side, side, 1) for side in (21, 13, 11, 8, 6, 5, 5)]
    found = mixture(tiles)
    assert found.shape == (21, 21, 5)
    torch.testing.assert_close(found, (direction * MIXED / 7).expand_as(found))
    tiles[6] = torch.randn(5, 5, 5)
    assert torch.equal(mixture(tiles), found)


def test_as_many_directions_as_words_come_back_whole():
    book = Codebook(WORDS, 4, torch.Generator().manual_seed(0))
    features = torch.cat([torch.eye(WORDS), torch.ones(WORDS, 4)], dim=1)
    book.words.data = features.clone()
    assert book.indices(features).tolist() == list(range(WORDS))
    assert float(book.likeness(features).amax(dim=1).min()) == pytest.approx(1 + REGULARISER, rel=1e-6)
    assert float(book.loss(features) - even_use(book.likeness(features))) == pytest.approx(0.0, abs=1e-6)


def test_training_finds_separated_directions():
    draw = torch.Generator().manual_seed(0)
    book = Codebook(16, 0, draw)
    rows = torch.nn.functional.normalize(torch.randn(6, 16, generator=draw), dim=1).repeat(40, 1)
    for step in range(400):
        book.set_rate(step)
        book.optimizer.zero_grad()
        book.loss(rows).backward()
        book.optimizer.step()
    cosine = torch.nn.functional.normalize(book.words, dim=1)[book.indices(rows)] @ rows.T
    assert float(cosine.diagonal().min()) > 0.95


def test_the_rate_falls_to_a_tenth_over_a_thousand_passes():
    book = Codebook(4, 0, torch.Generator())
    rates = []
    for passes in (0, 500, 1000, 2000):
        book.set_rate(passes)
        rates.append(book.optimizer.param_groups[0]["lr"])
    assert rates == pytest.approx([1e-4, 0.55e-4, 1e-5, 1e-5])


@pytest.mark.parametrize(("uncertainty", "weight"), [(0.0, LEAST_SMOOTHING), (1.0, 1.0)])
def test_smoothing_moves_codes_by_their_uncertainty_and_the_fit_moves_the_prediction(uncertainty, weight):
    codes, predicted = torch.zeros(4, 8, requires_grad=True), torch.ones(4, 8, requires_grad=True)
    u = torch.full((4,), uncertainty, requires_grad=True)
    loss = smoothing(codes, predicted, u)
    assert float(loss) == pytest.approx(1.0 + weight)
    loss.backward()
    torch.testing.assert_close(codes.grad, torch.full((4, 8), -2 * weight / 32))
    torch.testing.assert_close(predicted.grad, torch.full((4, 8), 2 / 32))
    assert u.grad is None
