"""Target codes of pixels: by view, by instance, or none."""

import torch

from tests.support.scenes import LEVELS


def test_pixels_have_the_code_of_their_instance(prepared, labels):
    found = prepared()[1].of(0)
    assert found.codes.shape == (2, 3, 24, 24) and found.known.shape == (2, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0] >= 0))
    left = torch.from_numpy(labels[0, 1] == 0)
    assert found.codes[1][:, left].T.unique(dim=0).tolist() == [[1.0, 0.0, 0.5]]
    assert float(found.codes[0][:, ~found.known[0]].abs().max()) == 0.0


def test_a_view_too_small_to_be_encoded_has_the_consistent_code(prepared):
    found = prepared(rows=[(0, 0)])[1].of(0)
    assert bool(found.known[1].all())


def test_without_aggregation_there_is_no_consistent_code(prepared, labels):
    found = prepared(target="view", rows=[(0, 0)])[1].of(0)
    assert torch.equal(found.known[1], torch.from_numpy(labels[0, 1] == 0))
    assert not found.known[0].any()


def test_a_level_without_instances_is_no_target(prepared, labels):
    every = prepared(levels=(1, 1, 1))[1]
    found = every.of(0)
    assert every.levels == LEVELS[1:2]
    assert found.codes.shape == (1, 3, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0, 1:2] >= 0))
