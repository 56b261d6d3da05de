"""Target codes of pixels: by view, by instance, or none."""

import torch

from egosplat.language.targets import CodeTargets

CPU = torch.device("cpu")


def targets(opened, folder, frame: int):
    _, _, instances, features = opened(folder)
    return CodeTargets(instances, features, CPU).of(frame)


def test_pixels_have_the_code_of_their_instance(scene, opened, labels):
    found = targets(opened, scene(), 0)
    assert found.codes.shape == (2, 3, 24, 24) and found.known.shape == (2, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0] >= 0))
    left = torch.from_numpy(labels[0, 1] == 0)
    assert found.codes[1][:, left].T.unique(dim=0).tolist() == [[1.0, 0.0, 0.5]]
    assert float(found.codes[0][:, ~found.known[0]].abs().max()) == 0.0


def test_a_view_too_small_to_be_encoded_has_the_consistent_code(scene, opened):
    found = targets(opened, scene(rows=[(0, 0)]), 0)
    assert bool(found.known[1].all())


def test_without_aggregation_there_is_no_consistent_code(scene, opened, labels):
    found = targets(opened, scene(target="view", rows=[(0, 0)]), 0)
    assert torch.equal(found.known[1], torch.from_numpy(labels[0, 1] == 0))
    assert not found.known[0].any()


def test_a_level_without_instances_is_no_target(scene, opened, labels):
    folder = scene(levels=(1, 1, 1))
    _, _, instances, features = opened(folder)
    every = CodeTargets(instances, features, CPU)
    found = every.of(0)
    assert every.levels == instances.facts["levels"][1:2]
    assert found.codes.shape == (1, 3, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0, 1:2] >= 0))
