"""The whole reference rasterizer: gradients, hand-computed values, culling, non-finite numbers."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from egosplat.geometry import make_pose
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference.rasterizer import rasterization

WIDTH, HEIGHT = 18, 15
GAUSSIAN_NAMES = ("means", "quats", "scales", "opacities", "colors", "features")


def scene(count: int, seed: int, cameras: int = 1, sh: bool = False) -> dict[str, Tensor]:
    """Float64 Gaussians in front of several cameras; opacities leave no pixel opaque."""
    rng = np.random.default_rng(seed)
    depths = rng.uniform(1.5, 3.0, count)
    means = np.stack([rng.uniform(-0.6, 0.6, count) * depths, rng.uniform(-0.5, 0.5, count) * depths, depths])
    turns = Rotation.from_rotvec(rng.normal(size=(cameras, 3)) * 0.1).as_matrix()
    arrays = {
        "means": means.T,
        "quats": rng.normal(size=(count, 4)),
        "scales": rng.uniform(0.05, 0.4, (count, 3)),
        "opacities": rng.uniform(0.2, 0.8, count),
        "colors": rng.normal(size=(count, 16, 3)) * 0.5 if sh else rng.uniform(size=(count, 3)),
        "features": rng.normal(size=(count, 2)),
        "viewmats": make_pose(turns, rng.normal(size=(cameras, 3)) * 0.1),
        "Ks": np.tile([[15.0, 0, 9.2], [0, 16.0, 8.7], [0, 0, 1]], (cameras, 1, 1)),
        "backgrounds": rng.uniform(size=(cameras, 5)),
    }
    return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("render_mode", "rasterize_mode", "sh_degree", "cameras", "count"),
    [
        ("RGB", "classic", None, 1, 5),
        ("RGB+ED", "classic", None, 1, 5),
        ("RGB+D", "antialiased", 3, 1, 2),
        ("RGB", "classic", 2, 2, 1),
        ("D", "antialiased", None, 1, 5),
        ("ED", "classic", None, 2, 2),
    ],
)
def test_gradients_equal_finite_differences(render_mode, rasterize_mode, sh_degree, cameras, count, seed):
    values = scene(count, seed, cameras, sh=sh_degree is not None)
    Ks = values.pop("Ks")
    options = {"sh_degree": sh_degree, "render_mode": render_mode, "rasterize_mode": rasterize_mode}
    weights: list[Tensor] = []

    def loss(*inputs: Tensor) -> Tensor:
        arguments = dict(zip(values, inputs, strict=True)) | options
        image, alpha, _ = rasterization(Arguments(**arguments, Ks=Ks, width=WIDTH, height=HEIGHT))
        if not weights:
            generator = torch.Generator().manual_seed(seed)
            weights.extend(torch.randn(*s.shape, dtype=s.dtype, generator=generator) for s in (image, alpha))
        return (image * weights[0]).sum() + (alpha * weights[1]).sum()

    inputs = [value.requires_grad_() for value in values.values()]
    assert torch.autograd.gradcheck(loss, inputs, atol=1e-5, rtol=1e-4)
    unused = {"colors", "features", "backgrounds"} if render_mode in ("D", "ED") else set()
    gradients = torch.autograd.grad(loss(*inputs), inputs, materialize_grads=True)
    for name, gradient in zip(values, gradients, strict=True):
        assert (gradient.abs().max() > 1e-3) == (name not in unused), name


def one(**changes: object) -> tuple[Tensor, Tensor, dict]:
    """One round Gaussian, 2 m ahead, at the center of the pixel in row 8, column 9 of a float64 image."""
    arguments = {
        "means": [[0.0, 0.0, 2.0]],
        "quats": [[1.0, 0.0, 0.0, 0.0]],
        "scales": [[0.3, 0.3, 0.3]],
        "opacities": [0.8],
        "colors": [[0.25, 0.5, 1.0]],
        "viewmats": np.eye(4)[None],
        "Ks": [[[15.0, 0.0, 9.5], [0.0, 15.0, 8.5], [0.0, 0.0, 1.0]]],
    } | changes
    tensors = {name: double(each) for name, each in arguments.items() if isinstance(each, (list, np.ndarray))}
    return rasterization(Arguments(**arguments | tensors, width=WIDTH, height=HEIGHT))


def double(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values, dtype=np.float64))


def test_one_gaussian_has_the_profile_of_its_projection():
    image, alpha, meta = one()
    variance = (15.0 * 0.3 / 2.0) ** 2 + 0.3
    rows, columns = torch.meshgrid(torch.arange(HEIGHT) - 8.0, torch.arange(WIDTH) - 9.0, indexing="ij")
    expected = 0.8 * torch.exp(-(rows**2 + columns**2).double() / (2 * variance))
    expected[expected < 1 / 255] = 0
    torch.testing.assert_close(alpha[0, ..., 0], expected, atol=1e-12, rtol=0)
    torch.testing.assert_close(image[0], expected[..., None] * double([0.25, 0.5, 1.0]))
    assert meta["radii"].dtype == torch.int32
    assert (meta["radii"] == math.ceil(math.sqrt(2 * math.log(255 * 0.8) * variance))).all()
    assert (meta["width"], meta["height"], meta["n_cameras"]) == (WIDTH, HEIGHT, 1)


def test_depth_is_accumulated_or_divided_by_alpha():
    background = [[1.0, 1.0, 1.0]]
    accumulated, alpha, _ = one(render_mode="D", backgrounds=background)
    torch.testing.assert_close(accumulated, 2.0 * alpha)
    expected = one(render_mode="ED", backgrounds=background)[0]
    torch.testing.assert_close(expected[alpha > 0], torch.full_like(expected[alpha > 0], 2.0))
    assert (expected[alpha == 0] == 0).all() and (alpha == 0).any()
    colors = one(backgrounds=background)[0]
    for mode, depth in (("RGB+D", accumulated), ("RGB+ED", expected)):
        both = one(render_mode=mode, backgrounds=background)[0]
        torch.testing.assert_close(both, torch.cat([colors, depth], dim=-1))


def test_spherical_harmonics_become_colors():
    coeffs = np.zeros((1, 4, 3))
    coeffs[0, 0], coeffs[0, 2, 1] = [1.0, -1.0, -9.0], 0.5
    # Viewed along +z: the constant term plus the z term, clamped at 0.
    constant, along_z = math.sqrt(1 / (4 * math.pi)), math.sqrt(3 / (4 * math.pi))
    image = one(colors=coeffs, sh_degree=1)[0]
    expected = double([0.5 + constant, 0.5 - constant + 0.5 * along_z, 0.0])
    torch.testing.assert_close(image[0, 8, 9] / 0.8, expected)
    assert one(colors=coeffs, sh_degree=0)[0][0, 8, 9, 1].item() / 0.8 == pytest.approx(0.5 - constant)


def test_viewing_directions_are_in_world_axes():
    coeffs = np.random.default_rng(0).normal(size=(1, 16, 3)) * 0.1
    straight = one(colors=coeffs, sh_degree=3)[0]
    # Rotating the camera keeps the viewing direction; moving it does not.
    turn = make_pose(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.zeros(3))
    turned = one(colors=coeffs, sh_degree=3, viewmats=turn[None])[0]
    torch.testing.assert_close(turned[0, 8, 9], straight[0, 8, 9])
    around = make_pose(Rotation.from_euler("y", 90, degrees=True).as_matrix(), np.array([0.0, 0.0, 0.0]))
    elsewhere = one(colors=coeffs, sh_degree=3, means=[[-2.0, 0.0, 0.0]], viewmats=around[None])[0]
    assert (elsewhere[0, 8, 9] - straight[0, 8, 9]).abs().max() > 0.01


HOSTILE = [(name, value) for name in GAUSSIAN_NAMES for value in (math.nan, math.inf, -math.inf)]


@pytest.mark.parametrize("sh", [False, True])
@pytest.mark.parametrize(("name", "value"), [*HOSTILE, ("quats", 0.0), ("scales", 1e300), ("means", 1e300)])
def test_broken_gaussians_are_not_rendered(name, value, sh):
    values = scene(6, 3, cameras=2, sh=sh)
    options = {"sh_degree": 3 if sh else None, "render_mode": "RGB+ED", "rasterize_mode": "antialiased"}
    size = {"width": WIDTH, "height": HEIGHT}
    rest = {key: each[:5] if key in GAUSSIAN_NAMES else each for key, each in values.items()}
    expected, expected_alpha, _ = rasterization(Arguments(**rest, **size, **options))
    values[name][5] = value
    values = {key: each if key == "Ks" else each.requires_grad_() for key, each in values.items()}
    image, alpha, meta = rasterization(Arguments(**values, **size, **options))
    torch.testing.assert_close(image, expected)
    torch.testing.assert_close(alpha, expected_alpha)
    assert (meta["radii"][:, 5] == 0).all() and (meta["radii"][:, :5] > 0).all()
    (image.square().sum() + alpha.sum()).backward()
    for key, each in values.items():
        if key != "Ks":
            assert each.grad.isfinite().all(), key
            assert key not in GAUSSIAN_NAMES or (each.grad[5] == 0).all(), key


@pytest.mark.parametrize("count", [0, 3])
def test_an_empty_view_still_has_gradients(count):
    values = {name: each.requires_grad_() for name, each in scene(count, 0, cameras=2).items()}
    values["means"] = values["means"] * torch.tensor([1.0, 1.0, -1.0])
    image, alpha, meta = rasterization(Arguments(**values, width=WIDTH, height=HEIGHT, render_mode="RGB+ED"))
    meta["means2d"].retain_grad()
    image.sum().backward()
    assert (alpha == 0).all() and (image[..., :5] == values["backgrounds"][:, None, None]).all()
    assert meta["means2d"].grad.shape == (2, count, 2) and (meta["means2d"].grad == 0).all()
    assert (values["backgrounds"].grad == WIDTH * HEIGHT).all()


def test_cameras_are_independent_and_quaternions_of_any_length():
    values = scene(8, 4, cameras=3)
    both, _, meta = rasterization(Arguments(**values, width=WIDTH, height=HEIGHT))
    values["quats"] *= torch.linspace(0.01, 50, 8)[:, None]
    for index in range(3):
        single = values | {name: values[name][index, None] for name in ("viewmats", "Ks", "backgrounds")}
        image, _, single_meta = rasterization(Arguments(**single, width=WIDTH, height=HEIGHT))
        torch.testing.assert_close(image[0], both[index])
        torch.testing.assert_close(single_meta["means2d"][0], meta["means2d"][index])


def test_float32_is_close_to_float64():
    values = scene(40, 6, sh=True)
    options = {"width": WIDTH, "height": HEIGHT, "sh_degree": 3, "render_mode": "RGB+ED"}
    gradients = []
    for dtype in (torch.float32, torch.float64):
        inputs = {name: each.detach().to(dtype).requires_grad_() for name, each in values.items()}
        image, _, _ = rasterization(Arguments(**inputs, **options))
        image.square().sum().backward()
        gradients.append([inputs[name].grad.double() for name in (*GAUSSIAN_NAMES, "viewmats")])
    for single, double in zip(*gradients, strict=True):
        assert (single - double).norm() < 1e-4 * double.norm()
