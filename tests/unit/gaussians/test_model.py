"""The Gaussians' container checks its tensors, a render has the documented channels, and both may move to another world."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.similarity import moved, split_similarity
from egosplat.geometry import Camera, make_pose
from tests.support.gaussian_scene import CAMERA as OF_SCENE
from tests.support.gaussian_scene import SETTINGS
from tests.support.splats import colorful


def make(n: int, degree: int = 1, channels: int = 2, seed: int = 0) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)
    shapes = [(n, 3), (n, 4), (n, 3), (n,), (n, (degree + 1) ** 2, 3), (n, channels)]
    return Gaussians(*(torch.randn(shape, generator=generator) for shape in shapes))


@pytest.mark.parametrize(
    ("name", "value"),
    [*itertools.product(PARAMETERS, [math.nan, math.inf, -math.inf]), ("log_scales", 100.0)],
)
def test_finite_checks_every_parameter(name: str, value: float) -> None:
    gaussians = make(3)
    getattr(gaussians, name)[1].fill_(value)
    assert gaussians.finite().tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("name", "tensor"),
    [
        ("quats", torch.zeros(3, 3)),
        ("logit_opacities", torch.zeros(3, 1)),
        ("sh", torch.zeros(3, 5, 3)),
        ("sh", torch.zeros(3, 4)),
        ("features", torch.zeros(2, 7)),
        ("means", torch.zeros(3, 3, dtype=torch.float64)),
    ],
)
def test_mismatched_tensors_are_rejected(name: str, tensor: torch.Tensor) -> None:
    with pytest.raises(ValueError, match=name if tensor.dtype == torch.float32 else "float"):
        Gaussians(**(make(3).parameters() | {name: tensor}))


CAMERA = Camera(32, 24, 20.0, 20.0, 16.5, 12.5)


def one_in_front(color: float, feature: float) -> Gaussians:
    gaussians = make(1, degree=0, channels=1)
    gaussians.means[:] = torch.tensor([0.0, 0.0, 2.0])
    gaussians.log_scales.fill_(math.log(0.2))
    gaussians.logit_opacities.fill_(math.log(0.8 / 0.2))
    gaussians.sh.fill_((color - 0.5) / 0.28209479177387814)
    gaussians.features.fill_(feature)
    return gaussians.requires_grad_()


def picture(gaussians: Gaussians, pose: np.ndarray, mode: str, background: torch.Tensor | None):
    return render(
        gaussians,
        CAMERA,
        pose,
        RenderSettings(0.1, "black", "reference"),
        sh_degree=0,
        background=background,
        render_mode=mode,
    )


def test_render_orders_channels_color_feature_depth() -> None:
    image, alpha, meta = picture(one_in_front(0.9, 4.0), np.eye(4), "RGB+ED", torch.tensor([0.0, 0.5, 1.0]))
    assert image.shape == (24, 32, 5) and alpha.shape == (24, 32, 1) and meta["radii"].shape == (1, 1, 2)
    # The Gaussian's center is the center of pixel (16, 12); behind features there is nothing.
    expected = [0.72, 0.72 + 0.2 * 0.5, 0.72 + 0.2, 0.8 * 4.0, 2.0]
    torch.testing.assert_close(image[12, 16], torch.tensor(expected), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(image[0, 0, :4], torch.tensor([0.0, 0.5, 1.0, 0.0]))
    depth, _, _ = picture(one_in_front(0.9, 4.0), np.eye(4), "ED", torch.ones(3))
    torch.testing.assert_close(depth[12, 16], torch.tensor([2.0]), rtol=1e-4, atol=1e-4)


def test_render_inverts_the_pose_in_float64(monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    monkeypatch.setattr(
        "egosplat.gaussians.render.render_view",
        lambda view: given.append(view.viewmats) or (torch.zeros(1), torch.zeros(1), {}),
    )
    turn = Rotation.from_euler("xyz", [20, 130, -50], degrees=True).as_matrix()
    pose = make_pose(turn, np.array([40_000.0, -30_000.0, 5_000.0]))
    picture(one_in_front(0.9, 4.0), pose, "RGB", None)
    assert torch.equal(given[0][0], torch.from_numpy(np.linalg.inv(pose)).float())
    assert not torch.equal(given[0][0], torch.linalg.inv(torch.from_numpy(pose).float()))


def similarity(seed: int, scale: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return matrix


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("scale", [1.0, 0.3, 12.0])
def test_a_camera_that_moves_along_sees_the_same(truth, camera_to_world, degree, scale):
    gaussians, matrix = colorful(truth, degree), similarity(degree, scale)
    pose = camera_to_world[2]
    along = matrix @ pose
    along[:3, :3] /= scale
    near = replace(SETTINGS, near_plane=0.1 * scale)
    before, after = (
        render(each, OF_SCENE, where, settings, sh_degree=degree, background=None)[0]
        for each, where, settings in ((gaussians, pose, SETTINGS), (moved(gaussians, matrix), along, near))
    )
    # The renderer widens Gaussians by a share of a pixel, whatever the scale.
    torch.testing.assert_close(after, before, atol=2e-4, rtol=0)


@pytest.mark.parametrize(
    "diagonal", [[1.0, 1, -1, 1], [1.0, 2, 1, 1], [0.0] * 4, [np.nan] * 4, [1e39] * 3 + [1], [1e300] * 4]
)
def test_what_is_no_similarity_is_refused(diagonal):
    with pytest.raises(ValueError, match="rotation"):
        split_similarity(np.diag(diagonal))
