"""The compiled kernels equal the reference in float64: values, gradients, extreme inputs."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from egosplat.rasterize import cpu
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference import rasterizer as reference

WIDTH, HEIGHT = 67, 51
VALUE_TOLERANCE = 1e-5
"""Largest absolute difference of float32 images of about unit size to those of float64."""
GRADIENT_TOLERANCE = 1e-5
"""Relative difference of float32 gradients to those of float64, in the L2 norm over all Gaussians."""


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


def undecided(meta: dict) -> Tensor:
    """(C, H, W) pixels where rounding may decide whether a Gaussian is composited; only there may float32 and float64 differ by much."""
    rows, columns = torch.meshgrid(
        torch.arange(meta["height"]) + 0.5, torch.arange(meta["width"]) + 0.5, indexing="ij"
    )
    masks = []
    for camera in range(meta["n_cameras"]):
        order = meta["depths"][camera].argsort()
        order = order[(meta["radii"][camera, order] > 0).all(dim=-1)]
        mean, conic = meta["means2d"][camera, order], meta["conics"][camera, order]
        dx, dy = columns[..., None] - mean[:, 0], rows[..., None] - mean[:, 1]
        sigma = 0.5 * (conic[:, 0] * dx * dx + conic[:, 2] * dy * dy) + conic[:, 1] * dx * dy
        raw = meta["opacities"][camera, order] * torch.exp(-sigma)
        alpha = torch.where(raw >= 1 / 255, raw.clamp(max=0.999), 0.0)
        left = (1 - alpha).cumprod(dim=-1)
        close = torch.stack([raw * 255 - 1, raw / 0.999 - 1, left / 1e-4 - 1]).abs() < 1e-4
        masks.append(close.any(dim=-1).any(dim=0))
    return torch.stack(masks)


def unsure(values: dict[str, Tensor], **options) -> Tensor:
    """(C, H, W) pixels to exclude: undecided ones, and those where the expected depth is a quotient of two tiny numbers."""
    with torch.no_grad():
        _, alpha, meta = reference.rasterization(Arguments(**values, width=WIDTH, height=HEIGHT, **options))
    return undecided(meta) | (alpha[..., 0] < 0.05)


def differentiate(backend, values: dict[str, Tensor], dtype: torch.dtype, **options) -> dict[str, Tensor]:
    """Render, backpropagate a random combination of the images, and return images and all gradients."""
    values = {
        name: value.detach().clone().to(dtype).requires_grad_(name != "Ks") for name, value in values.items()
    }
    skip = options.pop("skip", None)
    image, alpha, meta = backend.rasterization(Arguments(**values, width=WIDTH, height=HEIGHT, **options))
    meta["means2d"].retain_grad()
    generator = torch.Generator().manual_seed(7)
    weights = [torch.randn(*part.shape, generator=generator, dtype=torch.float64) for part in (image, alpha)]
    if skip is not None:
        weights = [weight * ~skip[..., None] for weight in weights]
    sum(
        (part * weight.to(dtype)).sum() for part, weight in zip((image, alpha), weights, strict=True)
    ).backward()
    gradients = {f"d {name}": value.grad for name, value in values.items() if value.grad is not None}
    return {"image": image, "alpha": alpha, "meta": meta, "d means2d": meta["means2d"].grad} | gradients


def relative(value: Tensor, truth: Tensor) -> float:
    return ((value.double() - truth).norm() / truth.norm().clamp(min=1e-30)).item()


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(
    "options",
    [
        {"sh_degree": 3},
        {"sh_degree": 2, "render_mode": "RGB+ED", "rasterize_mode": "antialiased"},
    ],
    ids=["classic", "antialiased with depth"],
)
def test_cpu_kernels_agree_with_float64(seed, options):
    values = scene(seed)
    skip = unsure(values, **options)
    truth = differentiate(reference, values, torch.float64, skip=skip, **options)
    found = differentiate(cpu, values, torch.float32, skip=skip, **options)
    assert torch.equal(found["meta"]["radii"], truth["meta"]["radii"])
    for name in ("image", "alpha"):
        difference = (found[name] - truth[name]).abs() * ~skip[..., None]
        assert difference.max() < VALUE_TOLERANCE, name
    gradients = [name for name in truth if name.startswith("d ")]
    assert len(gradients) == 9
    assert {name: relative(found[name], truth[name]) for name in gradients} == pytest.approx(
        dict.fromkeys(gradients, 0.0), abs=GRADIENT_TOLERANCE
    )


@pytest.mark.parametrize("render_mode", ["RGB", "D", "ED", "RGB+D"])
def test_two_cameras_agree_with_float64_in_every_mode(render_mode):
    values = scene(11, cameras=2) | {"colors": scene(12)["features"][:, :4]}
    values["backgrounds"] = torch.rand(2, 9, dtype=torch.float64)
    options = {"render_mode": render_mode}
    skip = unsure(values, **options)
    truth = differentiate(reference, values, torch.float64, skip=skip, **options)
    found = differentiate(cpu, values, torch.float32, skip=skip, **options)
    assert found["image"].shape == truth["image"].shape == (2, HEIGHT, WIDTH, truth["image"].shape[-1])
    assert ((found["image"] - truth["image"]).abs() * ~skip[..., None]).max() < VALUE_TOLERANCE
    for name in truth:
        if name.startswith("d ") and truth[name].abs().max() > 0:
            assert relative(found[name], truth[name]) < 2 * GRADIENT_TOLERANCE, name


@pytest.mark.parametrize("features", [0, 1, 10, 13, 14, 30, 61])
def test_any_number_of_channels_agrees_with_float64(features):
    values = scene(3, count=150, features=features)
    if features == 0:
        del values["features"]
    skip = unsure(values, sh_degree=0)
    truth = differentiate(reference, values, torch.float64, sh_degree=0, skip=skip)
    found = differentiate(cpu, values, torch.float32, sh_degree=0, skip=skip)
    for name in truth:
        if name.startswith("d ") and truth[name].numel():
            assert relative(found[name], truth[name]) < GRADIENT_TOLERANCE, name


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


def test_without_gaussians_the_background_is_visible():
    rest = ("viewmats", "Ks", "backgrounds")
    values = {name: (value if name in rest else value[:0]).float() for name, value in scene(0).items()}
    image, alpha, _ = cpu.rasterization(Arguments(**values, width=5, height=4, sh_degree=0))
    assert torch.equal(image, values["backgrounds"][:, None, None].expand(1, 4, 5, 8)) and (alpha == 0).all()
