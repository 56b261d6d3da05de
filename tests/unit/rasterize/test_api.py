"""The choice of the backend and the passing of arguments; each backend has its own tests."""

from typing import Any

import pytest
import torch

from egosplat.errors import UserError
from egosplat.rasterize import api
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.kernels import library
from egosplat.rasterize.reference import rasterizer as reference

SIZE = {"width": 8, "height": 6}


def gaussians(dtype: torch.dtype = torch.float32) -> dict[str, Any]:
    tensors = {
        "means": torch.tensor([[0.0, 0.0, 2.0], [0.2, 0.1, 3.0]]),
        "quats": torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(2, 1),
        "scales": torch.full((2, 3), 0.2),
        "opacities": torch.tensor([0.5, 0.9]),
        "colors": torch.rand(2, 3, generator=torch.Generator().manual_seed(0)),
        "viewmats": torch.eye(4)[None],
        "Ks": torch.tensor([[[8.0, 0.0, 4.0], [0.0, 8.0, 3.0], [0.0, 0.0, 1.0]]]),
    }
    return {name: each.to(dtype) for name, each in tensors.items()} | SIZE


@pytest.fixture
def no_kernels(monkeypatch):
    monkeypatch.setattr(library, "is_compiled", lambda: False)
    monkeypatch.setattr(library, "why_not", lambda: "not compiled: run make install")
    api._warn_slow.cache_clear()
    yield
    api._warn_slow.cache_clear()


def test_without_kernels_the_reference_renders_with_one_warning(no_kernels, capsys):
    expected, expected_alpha, _ = reference.rasterization(Arguments(**gaussians()))
    for _ in range(3):
        image, alpha, _ = api.rasterization(**gaussians())
        assert torch.equal(image, expected) and torch.equal(alpha, expected_alpha)
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "plain PyTorch" in said and "run make install" in said


@pytest.mark.parametrize(("backend", "dtype"), [("auto", torch.float64), ("reference", torch.float32)])
def test_an_explicit_reference_backend_gives_no_warning(no_kernels, capsys, backend, dtype):
    image = api.rasterization(**gaussians(dtype), backend=backend)[0]
    assert torch.equal(image, reference.rasterization(Arguments(**gaussians(dtype)))[0])
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("device", "dtype", "kernels", "chosen"),
    [
        ("cuda", torch.float32, True, "cuda"),
        ("cuda", torch.float64, True, "reference"),
        ("cpu", torch.float32, True, "cpu"),
        ("cpu", torch.float64, True, "reference"),
        ("cpu", torch.float32, False, "reference"),
        ("mps", torch.float32, True, "reference"),
    ],
)
def test_auto_selects_the_backend_by_device(monkeypatch, no_kernels, device, dtype, kernels, chosen):
    class Means:
        is_cuda = device == "cuda"

    means = Means()
    means.dtype, means.device = dtype, torch.device(device)
    monkeypatch.setattr(library, "is_compiled", lambda: kernels)
    assert api._choose(means) == chosen


def test_stale_kernels_are_an_error_not_a_fallback(monkeypatch, no_kernels):
    monkeypatch.setattr(library, "is_compiled", lambda: True)
    with pytest.raises(UserError, match="make install"):
        api.rasterization(**gaussians())


def test_all_options_reach_the_backend(monkeypatch):
    given: dict[str, Any] = {}
    monkeypatch.setattr(reference, "rasterization", lambda arguments: given.update(vars(arguments)))
    options = {
        "near_plane": 0.2,
        "far_plane": 50.0,
        "radius_clip": 1.0,
        "eps2d": 0.1,
        "sh_degree": 0,
        "features": torch.zeros(2, 1),
        "backgrounds": torch.zeros(1, 4),
        "render_mode": "RGB+D",
        "rasterize_mode": "antialiased",
    }
    arguments = gaussians() | {"colors": torch.zeros(2, 1, 3)} | options
    api.rasterization(**arguments, backend="reference")
    assert given.keys() == arguments.keys()
    assert all(given[name] is arguments[name] for name in arguments)


def test_invalid_arguments_are_reported():
    with pytest.raises(ValueError, match="backend .*'gpu'.* auto"):
        api.rasterization(**gaussians(), backend="gpu")
    with pytest.raises(ValueError, match="opacities"):
        api.rasterization(**gaussians() | {"opacities": torch.zeros(3)})


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_cuda_without_a_device_is_reported():
    with pytest.raises(UserError, match="CUDA device"):
        api.rasterization(**gaussians(), backend="cuda")
