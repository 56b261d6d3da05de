"""The benchmark of the rasterizer compares on repeatable scenes."""

import pytest

from benchmarks.rasterizer import comparison, iteration, passes, table, timing
from benchmarks.rasterizer.scenes import make_problem, make_scene


def test_kernels_and_reference_do_the_same_work():
    """Times are compared of passes with the same image and gradients; alpha is clamped and pixels end early."""
    scene = make_scene(600, 45, 37)
    scene.opacities[::3] = 1.0
    problem = make_problem(scene, 3)
    found, wanted = passes.prepare_kernels(problem)(), passes.prepare_torch(problem)()
    assert len(found) == len(wanted) == 5
    for tensor, expected in zip(found, wanted, strict=True):
        assert tensor.shape == expected.shape
        assert (tensor - expected).norm() <= 1e-4 * expected.norm()


def test_an_iteration_trains_and_changes_nothing(monkeypatch):
    """Learning rates are zero: each iteration of a camera costs the same, and has the same loss."""
    monkeypatch.setitem(iteration.SCENES, "A", (300, 40, 30))
    iteration._training.cache_clear()
    assert iteration.sample_iteration("A") > 0
    training = iteration._training("A")
    state, means = training.state, training.state.gaussians.means.clone()
    losses = []
    for _ in range(2):
        before = float(state.loss_sum)
        for _ in range(len(training.views)):
            training.iterate()
        losses.append(float(state.loss_sum) - before)
    assert losses[0] > 0 and losses[1] == pytest.approx(losses[0], rel=0.2)
    assert (state.gaussians.means == means).all()
    iteration._training.cache_clear()


def test_measurements_make_a_page():
    """Every rasterizer has a row in the table of passes, and each variant its ratio to torch."""
    times = {"avx2": timing.summary([5.0, 4.0, 9.0]), "torch": timing.summary([100.0])}
    raster = [{"scene": "D", "channels": 3, "rasterizer": name} | one for name, one in times.items()]
    iterations = [{"scene": "D", "variant": "avx2"} | times["avx2"]]
    page = table.page({"machine": comparison._machine(), "raster": raster, "iterations": iterations})
    assert "| avx2 | 5.0 / 4.0 |" in page and "| **torch / avx2** | 25.0x |" in page
    assert "| D | avx2 | 5.0 / 4.0 |" in page
