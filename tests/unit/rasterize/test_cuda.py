"""The call of gsplat, with a double that has gsplat's interface, and on a CUDA device if there is one."""

import fcntl
import math
import os
import sys
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.rasterize import cuda
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference import rasterizer as reference
from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics

SIZE = {"width": 20, "height": 14}


class GsplatDouble:
    """The used part of gsplat's interface, computed by the reference, with gsplat's treatment of masked and zero directions."""

    __version__ = "1.5.3"

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []

    def spherical_harmonics(self, degree: int, dirs: Tensor, coeffs: Tensor, masks: Tensor) -> Tensor:
        assert coeffs.shape[:-2] == dirs.shape[:-1] == masks.shape
        colors = torch.full_like(dirs, torch.nan)
        visible = masks.nonzero(as_tuple=True)
        units = dirs[visible] / dirs[visible].norm(dim=-1, keepdim=True)
        return colors.index_put(visible, spherical_harmonics(degree, units, coeffs[visible]))

    def rasterization(self, *, packed: bool, channel_chunk: int, **arguments: Any):
        self.calls.append(arguments | {"packed": packed, "channel_chunk": channel_chunk})
        colors = arguments.pop("colors")
        c = len(arguments["viewmats"])
        if colors.ndim == 2:
            colors = colors.expand(c, *colors.shape)
        per_camera = {"viewmats", "Ks", "backgrounds"}
        results = []
        for index in range(c):
            own = {
                name: value[index, None] if name in per_camera and value is not None else value
                for name, value in arguments.items()
            }
            # The reference, unlike gsplat, culls where a color is undefined.
            results.append(reference.rasterization(Arguments(**own, colors=colors[index].nan_to_num())))
        images, alphas, metas = zip(*results, strict=True)
        meta = {name: torch.cat([each[name] for each in metas]) for name in ("means2d", "radii", "depths")}
        meta |= {name: torch.cat([each[name] for each in metas]) for name in ("conics", "opacities")}
        meta |= {"width": 20, "height": 14, "n_cameras": c, "flatten_ids": torch.zeros(1), "tile_size": 16}
        return torch.cat(images), torch.cat(alphas), meta


def scene(sh: bool, dtype: torch.dtype, device: str = "cpu") -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(3)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    n = 12
    viewmats = torch.eye(4, dtype=torch.float64).repeat(2, 1, 1)
    viewmats[1, :3, 3] = torch.tensor([0.2, -0.1, 0.3])
    K = torch.tensor([[18.0, 0, 10.2], [0, 17.0, 7.1], [0, 0, 1]], dtype=torch.float64)
    tensors = {
        "means": uniform(n, 3) * torch.tensor([2.0, 1.6, 2.0]) - torch.tensor([1.0, 0.8, -1.5]),
        "quats": uniform(n, 4) - 0.5,
        "scales": 0.05 + 0.3 * uniform(n, 3),
        "opacities": 0.2 + 0.7 * uniform(n),
        "colors": uniform(n, 16, 3) - 0.5 if sh else uniform(n, 3),
        "features": uniform(n, 4),
        "viewmats": viewmats,
        "Ks": K.repeat(2, 1, 1),
        "backgrounds": uniform(2, 7),
    }
    return {name: each.to(device, dtype).requires_grad_(name != "Ks") for name, each in tensors.items()}


def gradients(image: Tensor, alpha: Tensor, inputs: dict[str, Tensor]) -> dict[str, Tensor]:
    leaves = {name: each for name, each in inputs.items() if each.requires_grad}
    loss = image.square().sum() + alpha.sum()
    found = torch.autograd.grad(loss, [*leaves.values()], materialize_grads=True)
    return dict(zip(leaves, found, strict=True))


MODES = [
    (True, "RGB", "classic"),
    (True, "RGB+ED", "antialiased"),
    (True, "ED", "classic"),
    (False, "RGB+D", "antialiased"),
    (False, "D", "classic"),
]


@pytest.mark.parametrize(("sh", "render_mode", "rasterize_mode"), MODES)
@pytest.mark.parametrize("hostile", [False, True])
def test_gsplat_gets_arguments_for_the_same_image(sh, render_mode, rasterize_mode, hostile):
    inputs = scene(sh, torch.float64)
    if hostile:
        with torch.no_grad():
            inputs["means"][0, 1] = inputs["features"][1, 2] = math.nan
            inputs["colors"][2], inputs["scales"][3], inputs["quats"][4] = math.inf, math.inf, 0.0
            inputs["opacities"][5] = math.nan
            # At the first camera's center, which has no viewing direction.
            inputs["means"][6] = 0.0
    modes = {"render_mode": render_mode, "rasterize_mode": rasterize_mode, "sh_degree": 3 if sh else None}
    arguments = inputs | SIZE | modes
    image, alpha, meta = cuda.render(GsplatDouble(), Arguments(**arguments))
    expected, expected_alpha, expected_meta = reference.rasterization(Arguments(**arguments))
    torch.testing.assert_close(image, expected)
    torch.testing.assert_close(alpha, expected_alpha)
    assert meta.keys() == expected_meta.keys() and torch.equal(meta["radii"], expected_meta["radii"])
    found = gradients(image, alpha, inputs)
    for name, gradient in gradients(expected, expected_alpha, inputs).items():
        torch.testing.assert_close(found[name], gradient, msg=name)


def test_options_pass_through_and_gsplat_s_traps_are_avoided():
    double, inputs = GsplatDouble(), scene(False, torch.float32)
    given = {"near_plane": 0.2, "far_plane": 30.0, "radius_clip": 1.0, "eps2d": 0.2}
    cuda.render(double, Arguments(**inputs, **SIZE, **given))
    call = double.calls[0]
    assert given.items() <= call.items() and SIZE.items() <= call.items()
    assert call["packed"] is False and call["channel_chunk"] == 7
    assert call["means"] is inputs["means"], "usable Gaussians are not copied"
    for features, mode, chunk in ((29, "RGB+D", 33), (29, "RGB", 32), (60, "RGB", 33)):
        wide = inputs | {"features": torch.rand(12, features), "backgrounds": None}
        cuda.render(double, Arguments(**wide, **SIZE, render_mode=mode))
        assert double.calls[-1]["channel_chunk"] == chunk


@pytest.fixture
def installed(monkeypatch):
    """Pretend a CUDA device and an installed gsplat: ``installed(version, compiled)``."""

    def install(version: str, compiled: object) -> object:
        double = GsplatDouble()
        double.__version__ = version
        monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
        monkeypatch.setitem(sys.modules, "gsplat", double)
        monkeypatch.setitem(sys.modules, "gsplat.cuda", SimpleNamespace())
        monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", SimpleNamespace(_C=compiled))
        return double

    return install


@pytest.mark.parametrize("version", ["1.5.3", "1.5.4", "1.5.3+pt24cu124", "1.5.10rc1"])
def test_a_supported_gsplat_is_loaded(installed, version):
    assert installed(version, object()) is cuda.load_gsplat()


@pytest.mark.parametrize(
    ("version", "compiled", "words"),
    [
        ("1.5.2", object(), "1.5.2 is too old"),
        ("1.4", object(), "too old"),
        ("1.6.0", object(), "1.6.0 is too new"),
        ("1.6.0a1", object(), "too new"),
        ("1.10", object(), "too new"),
        ("2.0.0a1", object(), "too new"),
        ("1.5.3", None, "no CUDA toolkit"),
    ],
)
def test_an_unusable_gsplat_is_reported(installed, version, compiled, words):
    installed(version, compiled)
    with pytest.raises(UserError, match=words) as told:
        cuda.load_gsplat()
    assert 'pip install "egosplat[cuda]"' in str(told.value) and "nvcc" in str(told.value)


def test_a_missing_gsplat_and_tensors_elsewhere_are_reported(installed, monkeypatch):
    installed("1.5.3", object())
    with pytest.raises(UserError, match="CUDA device.* cpu"):
        cuda.rasterization(Arguments(**scene(False, torch.float32), **SIZE))
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(UserError, match="gsplat .*pip install"):
        cuda.load_gsplat()


def test_gsplat_is_compiled_by_one_process_with_few_compilers(monkeypatch, tmp_path):
    """Two jobs that start together would remove each other's build; ten compilers exceed a job's memory."""
    monkeypatch.delitem(sys.modules, "gsplat.cuda._backend", raising=False)
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "new"))
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "2100")
    monkeypatch.setenv("MAX_JOBS", "")  # so that it is absent again afterwards
    monkeypatch.delenv("MAX_JOBS")
    with cuda._alone_if_compiling():
        assert os.environ["MAX_JOBS"] == "1"
        with (tmp_path / "new" / "egosplat_gsplat.lock").open() as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (tmp_path / "new" / "egosplat_gsplat.lock").open() as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    monkeypatch.setattr(fcntl, "flock", lambda *_: os.stat("a file system without locks"))
    with cuda._alone_if_compiling():
        assert os.environ["MAX_JOBS"] == "1"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize(("sh", "render_mode", "rasterize_mode"), MODES)
def test_gsplat_agrees_on_the_device(sh, render_mode, rasterize_mode):
    options = {"sh_degree": 3 if sh else None, "render_mode": render_mode, "rasterize_mode": rasterize_mode}
    inputs, doubles = scene(sh, torch.float32, "cuda"), scene(sh, torch.float64, "cuda")
    image, alpha, meta = cuda.rasterization(Arguments(**inputs, **SIZE, **options))
    expected, expected_alpha, expected_meta = reference.rasterization(Arguments(**doubles, **SIZE, **options))
    torch.testing.assert_close(image.double(), expected, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(alpha.double(), expected_alpha, atol=1e-4, rtol=1e-4)
    assert torch.equal(meta["radii"], expected_meta["radii"])
    found = gradients(image, alpha, inputs)
    for name, gradient in gradients(expected, expected_alpha, doubles).items():
        assert (found[name].double() - gradient).norm() <= 1e-3 * gradient.norm() + 1e-6, name


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_non_finite_gaussians_are_culled_on_the_device():
    inputs = scene(True, torch.float32, "cuda")
    with torch.no_grad():
        inputs["means"][0], inputs["quats"][1], inputs["colors"][2] = math.nan, 0.0, math.inf
        inputs["means"][3] = 0.0
    image, alpha, meta = cuda.rasterization(Arguments(**inputs, **SIZE, sh_degree=3))
    assert image.isfinite().all() and (meta["radii"][:, :3] == 0).all()
    assert all(gradient.isfinite().all() for gradient in gradients(image, alpha, inputs).values())
