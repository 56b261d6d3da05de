"""splats.sh_degree = auto keeps the lowest sufficient degree of spherical harmonics."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.errors import UserError
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.training_views import Views
from egosplat.gaussians.view_dependence import DegreeSearch, mean_basis, reduce_degree, without_degree
from egosplat.geometry import Camera
from egosplat.pipeline.config import defaults
from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics
from egosplat.splats import stage

CAMERA = Camera(24, 24, 22.0, 22.0, 12.0, 12.0)
KEYS = (
    defaults()["camera"]
    | defaults()["splats"]
    | {
        "masking": "none",
        "iterations": 140,
        "max_gaussians": 60,
        "evaluate_every": 70,
        "sh_degree": "auto",
    }
)


def run(folder, name: str = "splats.zarr", **changes: object):
    """The verified artifact."""
    options = stage.SplatsOptions(**KEYS | changes)
    stage.run(folder / "frames.zarr", folder / "poses.zarr", folder / name, options)
    return verify(folder / name, SCHEMAS)


@pytest.fixture
def glossy(truth, camera_to_world) -> np.ndarray:
    """The pictures, were the Gaussians' red brighter from the left and their blue from the right."""
    sh = torch.cat([truth.sh, torch.zeros(truth.count, 3, 3)], dim=1)
    sh[:, 3] = torch.tensor([3.0, 0.0, -3.0])
    settings = RenderSettings(0.1, "black", False, "auto")
    options = {"sh_degree": 1, "background": None}
    images = [render(replace(truth, sh=sh), CAMERA, pose, settings, **options)[0] for pose in camera_to_world]
    return (torch.stack(images).clamp(0, 1) * 255).round().to(torch.uint8).numpy()


def test_a_matte_scene_gets_degree_0(scene, capsys):
    found = run(scene(), min_improvement=0.2)
    psnr = found.facts["sh_degree_psnr"]
    assert found.shape("sh")[1:] == (1, 3) and found.facts["sh_degree_in_use"] == 0
    assert len(psnr) == 4 and psnr[0] >= psnr[3] - 0.2
    assert "on 1 held-out photographs; degree 0 is sufficient" in capsys.readouterr().err


def test_a_glossy_scene_keeps_its_degree(scene, glossy):
    found = run(scene(rgb=glossy), min_improvement=0.2, iterations=1400)
    psnr, degree = found.facts["sh_degree_psnr"], found.facts["sh_degree_in_use"]
    assert psnr[0] < psnr[3] - 0.2 and degree >= 1 and found.shape("sh")[1] == (degree + 1) ** 2
    assert all(psnr[lower] < psnr[3] - 0.2 for lower in range(degree))


def test_the_deciding_frame_is_trained_on_afterwards(scene, pictures):
    """The middle one of eight training frames decides; it affects training only afterwards."""
    keys = {"min_improvement": 100.0, "densify_init": False}
    found = run(scene(), **keys)
    assert found.facts["views"] == {"training": 8, "validation": 0, "held out": 1}
    blank = pictures.copy()
    blank[5] = 0
    other = run(scene(rgb=blank), "other.zarr", **keys)
    same = found.read("curve/loss") == other.read("curve/loss")
    decided = found.read("curve/iteration") <= 140 // 2
    assert decided.any() and same[decided].all() and not same[~decided].all()


def test_with_patience_the_validation_frames_decide(scene):
    found = run(scene(), patience=5, min_improvement=100.0)
    assert found.facts["views"] == {"training": 7, "validation": 1, "held out": 1}
    assert found.facts["sh_degree_psnr"]


@pytest.mark.parametrize("iterations", [1, 2, 7, 10])
def test_a_short_run_chooses_a_degree(scene, iterations):
    found = run(scene(), iterations=iterations)
    psnr, degree = found.facts["sh_degree_psnr"], found.facts["sh_degree_in_use"]
    assert 1 <= len(psnr) <= 4 and degree <= len(psnr) - 1


def test_one_frame_cannot_validate(scene):
    one = np.zeros(9, bool)
    one[0] = True
    with pytest.raises(UserError, match="splats.sh_degree = auto.* 2 training frames"):
        run(scene(train=one))


def test_a_dropped_degree_leaves_its_mean_over_the_cameras(truth, camera_to_world):
    sh = torch.randn(truth.count, 16, 3, generator=torch.Generator().manual_seed(0))
    gaussians = replace(truth, sh=sh)
    means = mean_basis(truth.means, CAMERA, camera_to_world, near_plane=0.1)
    seen = means[:, 0] > 0
    assert seen.any()
    for degree in (1, 2, 3):
        simpler = without_degree(gaussians, degree, means)
        assert simpler.sh_degree == degree - 1 and simpler.sh.is_contiguous()
        change = torch.zeros(truth.count, 3)
        counted = torch.zeros(truth.count)
        for pose in camera_to_world:
            towards = truth.means - torch.from_numpy(pose[:3, 3]).float()
            local = towards @ torch.from_numpy(pose[:3, :3]).float()
            pixel = local[:, :2] / local[:, 2:] * 22.0 + 12.0
            inside = ((pixel >= 0) & (pixel < 24)).all(dim=1) & (local[:, 2] >= 0.1)
            difference = spherical_harmonics(degree, towards, sh) - spherical_harmonics(
                degree - 1, towards, simpler.sh
            )
            change += torch.where(inside[:, None], difference, 0.0)
            counted += inside
        assert torch.equal(counted > 0, seen)
        assert (change[seen] / counted[seen, None]).abs().max() < 1e-5
        assert torch.equal(simpler.sh[~seen], sh[~seen, : degree**2])


def test_without_valid_validation_pixels_the_degree_stays(truth, pictures, camera_to_world):
    gaussians = replace(truth, sh=torch.cat([truth.sh, torch.zeros(truth.count, 3, 3)], dim=1))
    some, poses = torch.from_numpy(pictures[:2]), camera_to_world[:2]
    moving = torch.ones(2, 24, 24, dtype=torch.bool)
    views = Views(np.arange(2), some, poses, None, moving, CAMERA, torch.device("cpu"))
    search, options = DegreeSearch(open=True), RenderSettings(0.1, "black", False, "auto")
    assert reduce_degree(search, gaussians, 1, views, views, options, tolerance_db=0.05) is gaussians
    assert search == DegreeSearch(open=False, psnr=[None, None])
    seen = replace(views, transient=None)
    assert reduce_degree(search, gaussians, 1, seen, seen, options, tolerance_db=0.05).sh_degree == 0


def test_unseen_gaussians_have_no_mean_colour(truth, camera_to_world):
    behind = truth.means * torch.tensor([1.0, 1.0, -1.0])
    assert not mean_basis(behind, CAMERA, camera_to_world, near_plane=0.1).any()
    assert mean_basis(truth.means[:0], CAMERA, camera_to_world, near_plane=0.1).shape == (0, 16)
