"""LangSplatV2's coefficients: four words a code, and no gradient for the others."""

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat_rivals.langsplat_v2 import WORDS, codebook, coefficients


def test_a_code_is_the_softmax_cut_to_four_over_its_sum_and_no_other_logit_gets_a_gradient():
    draw = torch.Generator().manual_seed(0)
    logits = torch.randn(50, WORDS, generator=draw).requires_grad_()
    words = torch.randn(WORDS, 16, generator=draw)
    code = coefficients(logits)
    whole = logits.detach().softmax(dim=-1)
    chosen = whole >= whole.topk(4, dim=-1).values[:, -1:]
    torch.testing.assert_close(code.detach(), whole * chosen / (whole * chosen).sum(dim=-1, keepdim=True))
    (code @ words).square().sum().backward()
    assert float(logits.grad[~chosen].abs().max()) < 1e-8 < float(logits.grad[chosen].abs().min())


def test_the_codebook_holds_the_centers_of_clusters():
    rng = np.random.default_rng(0)
    centers = np.eye(WORDS, 80, dtype=np.float32)
    rows = np.repeat(centers, 20, axis=0) + rng.normal(0, 1e-3, (20 * WORDS, 80)).astype(np.float32)
    found = codebook(rows, seed=0)
    assert found.shape == (WORDS, 80)
    nearest = np.linalg.norm(found[:, None] - centers, axis=-1).min(axis=1)
    assert np.median(nearest) < 0.01
    np.testing.assert_array_equal(found, codebook(rows, seed=0))


def test_few_different_features_are_the_codebook_and_none_is_an_error():
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]], np.float32)
    assert sorted(map(tuple, codebook(rows, 0))) == [(0.0, 1.0), (1.0, 0.0)]
    with pytest.raises(UserError, match=r"language\.method"):
        codebook(rows[:0], 0)
