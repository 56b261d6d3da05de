"""The bench compares like with like, on the scenes that it says, and notices a lost lead."""

import importlib
from types import ModuleType

import pytest
import torch

CHANNELS = 3
"""Of all problems: Numba compiles the peer anew for each number."""


@pytest.fixture
def bench():
    """Imports a module of the bench."""

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    return load


@pytest.fixture
def threads():
    """Restores the number of threads, which the test may change."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("number_of_threads", [1, 2])
def test_numba_peer_agrees_with_the_reference(bench, threads, number_of_threads: int) -> None:
    pytest.importorskip("numba")
    scenes, rasterizers = bench("benchmarks.rasterizer.scenes"), bench("benchmarks.rasterizer.rasterizers")
    torch.set_num_threads(number_of_threads)
    # No multiple of the tile's size; opaque enough that pixels end early and alpha is clamped.
    scene = scenes.make_scene(600, 45, 37)
    scene.opacities[::3] = 1.0
    problem = scenes.make_problem(scene, CHANNELS)
    wanted = rasterizers.prepare_torch(problem)()
    found = rasterizers.prepare_numba(problem)()
    assert len(found) == len(wanted) == 5
    for tensor, expected in zip(found, wanted, strict=True):
        assert tensor.shape == expected.shape
        assert (tensor - expected).norm() <= 1e-4 * expected.norm()


def test_counted_pairs_are_those_that_the_reference_composites(bench) -> None:
    pytest.importorskip("numba")
    scenes = bench("benchmarks.rasterizer.scenes")
    numba_rasterizer = bench("benchmarks.rasterizer.numba_rasterizer")
    problem = scenes.make_problem(scenes.make_scene(40, 32, 16), CHANNELS)
    columns, rows = torch.meshgrid(torch.arange(32) + 0.5, torch.arange(16) + 0.5, indexing="xy")
    transmittance, running, expected = torch.ones(16, 32), torch.ones(16, 32, dtype=torch.bool), 0
    for g in problem.depths.argsort():
        dx, dy = columns - problem.means2d[g, 0], rows - problem.means2d[g, 1]
        a, b, c = problem.conics[g]
        alpha = (problem.opacities[g] * torch.exp(-0.5 * (a * dx**2 + c * dy**2) - b * dx * dy)).clamp(
            max=0.999
        )
        seen = running & (alpha >= 1 / 255)
        ends = seen & (transmittance * (1 - alpha) <= 1e-4)
        running &= ~ends
        transmittance = torch.where(seen & ~ends, transmittance * (1 - alpha), transmittance)
        expected += int((seen & ~ends).sum())
    assert expected > 500
    assert abs(numba_rasterizer.count_pairs(problem)[1] - expected) <= 2


def test_scenes_are_repeatable_rooms_with_the_overdraw_of_trained_ones(bench) -> None:
    pytest.importorskip("numba")
    scenes = bench("benchmarks.rasterizer.scenes")
    numba_rasterizer = bench("benchmarks.rasterizer.numba_rasterizer")
    scene, again = scenes.make_scene(10_000, 64, 48), scenes.make_scene(10_000, 64, 48)
    assert torch.equal(scene.means, again.means)
    assert not torch.equal(scene.means, scenes.make_scene(10_000, 64, 48, seed=1).means)
    inside = scene.means.abs() <= torch.tensor([2.6, 2.6, 2.8])
    assert inside.all()
    torch.testing.assert_close(scene.quats.norm(dim=1), torch.ones(10_000))
    _, pairs = numba_rasterizer.count_pairs(scenes.make_problem(scene, CHANNELS))
    assert 25 <= pairs / (64 * 48) <= 60


def test_a_lost_lead_is_named(bench) -> None:
    rasterizer = bench("benchmarks.rasterizer.__main__")

    def rows(kernel_ms: float) -> list[dict]:
        return [
            {"scene": "D", "channels": count, "rasterizer": name, "cpu_ms_min": ms}
            for count in (3, 12)
            for name, ms in (
                ("avx2", kernel_ms if count == 12 else 10.0),
                ("numba", 100.0),
                ("torch", 1000.0),
            )
        ]

    assert rasterizer.shortfalls(rows(14.9), rows(10.0), "avx2") == []
    short = rasterizer.shortfalls(rows(15.1), rows(10.0), "avx2")
    assert len(short) == 2
    assert all("12 channels" in line for line in short)
    assert "numba" in short[0] and "torch" in short[1]
