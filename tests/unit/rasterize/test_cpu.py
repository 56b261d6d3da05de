"""The compiled kernels equal the reference in float64: values, gradients, extreme inputs."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from egosplat.rasterize import cpu
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference import rasterizer as reference
from tests.support.splats import undecided

WIDTH, HEIGHT = 67, 51


def scene(seed: int, count: int = 400, cameras: int = 1, features: int = 5) -> dict[str, Tensor]:
    """A cloud that fills the image, from specks to blobs as wide as the image, with opacities up to nearly 1."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(size=(cameras, 3)) * 0.1).as_matrix()
    viewmats = np.tile(np.eye(4), (cameras, 1, 1))
    viewmats[:, :3, :3], viewmats[:, :3, 3] = turns, rng.normal(size=(cameras, 3)) * 0.1
    arrays = {
        "means": rng.uniform(-0.5, 0.5, (count, 3)) * [3.0, 2.5, 3.0] + [0, 0, 3.0],
        "quats": rng.normal(size=(count, 4)),
        "scales": np.exp(rng.uniform(-4.5, -1.5, (count, 3))),
        "opacities": rng.uniform(0.01, 0.99, count),
        "colors": rng.normal(size=(count, 16, 3)) * 0.2,
        "features": rng.normal(size=(count, features)),
        "viewmats": viewmats,
        "Ks": np.tile([[75.0, 0, 33.0], [0, 70.0, 26.0], [0, 0, 1]], (cameras, 1, 1)),
        "backgrounds": rng.uniform(size=(cameras, 3 + features)),
    }
    return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}


def differentiate(
    backend, values: dict[str, Tensor], dtype: torch.dtype, skip: Tensor, **options
) -> dict[str, Tensor]:
    """Render, backpropagate a random combination of the images, and return images and all gradients."""
    values = {
        name: value.detach().clone().to(dtype).requires_grad_(name != "Ks") for name, value in values.items()
    }
    image, alpha, meta = backend.rasterization(Arguments(**values, width=WIDTH, height=HEIGHT, **options))
    meta["means2d"].retain_grad()
    generator = torch.Generator().manual_seed(7)
    shapes = (image.shape, alpha.shape)
    weights = [
        torch.randn(*shape, generator=generator, dtype=torch.float64) * ~skip[..., None] for shape in shapes
    ]
    sum(
        (part * weight.to(dtype)).sum() for part, weight in zip((image, alpha), weights, strict=True)
    ).backward()
    gradients = {f"d {name}": value.grad for name, value in values.items() if value.grad is not None}
    return {"image": image, "alpha": alpha, "meta": meta, "d means2d": meta["means2d"].grad} | gradients


def assert_agree(values: dict[str, Tensor], tolerance: float = 1e-5, **options: object) -> dict[str, Tensor]:
    """The reference's results, which those of the kernels equal: images to 1e-5, gradients to a relative L2 error."""
    with torch.no_grad():
        _, alpha, meta = reference.rasterization(Arguments(**values, width=WIDTH, height=HEIGHT, **options))
    # Where little is composited, the expected depth is a quotient of two tiny numbers.
    skip = undecided(meta) | (alpha[..., 0] < 0.05)
    truth = differentiate(reference, values, torch.float64, skip, **options)
    found = differentiate(cpu, values, torch.float32, skip, **options)
    assert torch.equal(found["meta"]["radii"], truth["meta"]["radii"])
    for name in ("image", "alpha"):
        assert found[name].shape == truth[name].shape
        assert ((found[name] - truth[name]).abs() * ~skip[..., None]).max() < 1e-5, name
    for name in truth.keys() - {"image", "alpha", "meta"}:
        error = (found[name].double() - truth[name]).norm()
        assert error <= tolerance * truth[name].norm(), name
    return truth


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(
    "options",
    [{"sh_degree": 3}, {"sh_degree": 2, "render_mode": "RGB+ED", "rasterize_mode": "antialiased"}],
    ids=["classic", "antialiased with depth"],
)
def test_cpu_kernels_agree_with_float64(seed, options):
    assert len(assert_agree(scene(seed), **options)) == 3 + 9


@pytest.mark.parametrize("render_mode", ["RGB", "D", "ED", "RGB+D"])
def test_two_cameras_agree_with_float64_in_every_mode(render_mode):
    values = scene(11, cameras=2) | {"colors": scene(12)["features"][:, :4]}
    values["backgrounds"] = torch.rand(2, 9, dtype=torch.float64)
    assert assert_agree(values, 2e-5, render_mode=render_mode)["image"].shape[:3] == (2, HEIGHT, WIDTH)


@pytest.mark.parametrize("features", [0, 1, 10, 13, 14, 30, 61])
def test_any_number_of_channels_agrees_with_float64(features):
    values = scene(3, count=150, features=features)
    if features == 0:
        del values["features"]
    assert_agree(values, sh_degree=0)


@pytest.mark.parametrize("frozen", ["geometry", "all but means"])
def test_inputs_without_gradient_get_none_and_change_nothing(frozen):
    values = {name: value.float() for name, value in scene(5).items()}
    free = ("colors", "features") if frozen == "geometry" else ("means",)
    gradients = []
    for asked in (free, tuple(name for name in values if name != "Ks")):
        inputs = {name: value.clone().requires_grad_(name in asked) for name, value in values.items()}
        image, *_ = cpu.rasterization(Arguments(**inputs, width=WIDTH, height=HEIGHT, sh_degree=3))
        image.square().sum().backward()
        gradients.append({name: inputs[name].grad for name in free})
        assert all((inputs[name].grad is None) == (name not in asked) for name in inputs)
    for name in free:
        assert torch.equal(gradients[0][name], gradients[1][name])
