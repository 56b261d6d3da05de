"""Early stopping waits for its patience and keeps the best Gaussians."""

import math

import pytest
import torch

from egosplat.gaussians.training_state import EarlyStop


def stops(
    psnrs: list[float], patience: int, min_improvement: float, gaussians
) -> tuple[EarlyStop, list[bool]]:
    stop = EarlyStop(patience, min_improvement)
    return stop, [stop.observe(index, psnr, gaussians) for index, psnr in enumerate(psnrs)]


@pytest.mark.parametrize(
    "psnrs, patience, min_improvement, expected",
    [
        ([20, 21, 22, 23], 1, 0.1, [False, False, False, False]),
        ([20, 21, 21, 21], 2, 0.1, [False, False, False, True]),
        ([20, 20.05, 20.1, 20.1], 3, 0.08, [False, False, False, False]),  # two small ones make one
        ([20, 20.05, 20.1, 20.1], 2, 0.15, [False, False, True, True]),
        ([20, math.nan, math.nan], 2, 0.1, [False, False, True]),
        ([math.nan, 20, 19, 21], 2, 0.1, [False, False, False, False]),
    ],
)
def test_training_stops_after_patience_evaluations(psnrs, patience, min_improvement, expected, truth):
    assert stops(psnrs, patience, min_improvement, truth)[1] == expected


def test_the_best_gaussians_are_kept_unchanged(truth):
    gaussians = truth.select(torch.arange(5))
    stop = EarlyStop(9, 1.0)
    stop.observe(10, 20.0, gaussians)
    before = gaussians.means.clone()
    gaussians.means += 1.0
    stop.observe(20, 19.0, gaussians)
    assert stop.best_iteration == 10 and torch.equal(stop.best.means, before)
    stop.observe(30, 20.1, gaussians)  # too little to wait on, but better
    assert stop.best_iteration == 30 and torch.equal(stop.best.means, gaussians.means) and stop.waited == 2


@pytest.mark.parametrize("psnrs", [[], [20.0, 20.5, 19.0]])
def test_early_stopping_resumes_from_its_state(psnrs, truth):
    stop, _ = stops(psnrs, 2, 1.0, truth)
    again = EarlyStop(2, 1.0)
    again.load_state_dict(stop.state_dict())
    assert vars(again) | {"best": None} == vars(stop) | {"best": None}
    assert (again.best is None) == (stop.best is None)
    assert [again.observe(9, 19.0, truth), again.observe(10, 19.0, truth)] == [
        stop.observe(9, 19.0, truth),
        stop.observe(10, 19.0, truth),
    ]
