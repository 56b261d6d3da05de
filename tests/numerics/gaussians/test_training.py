"""Training survives broken, empty and single-color input and excessive learning rates."""

import re
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.gaussians import loss as objective
from egosplat.gaussians import schedule
from egosplat.gaussians import trainer as state
from egosplat.gaussians.evaluation import mean_known
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import LearningRates
from egosplat.gaussians.training_views import pixel_weight
from egosplat.language.targets import Targets, code_l1
from tests.support.scenes import sideways

FRAMES, SIZE = 7, 20


def points(count: int = 40) -> np.ndarray:
    return np.random.default_rng(0).uniform([-1.2, -1.2, 1.9], [1.2, 1.2, 2.1], (count, 3))


def in_unit(unit: float) -> dict[str, np.ndarray]:
    """Poses and points of the scene in units of ``1 / unit`` m."""
    poses = sideways(np.linspace(-0.4, 0.4, FRAMES) * unit)
    return {"camera_to_world": poses, "points/xyz": points() * unit}


def colors(count: int) -> np.ndarray:
    return np.full((count, 3), 128, np.uint8)


@pytest.mark.numerics("points of 1e39 m, beyond float32", outside="dropped")
def test_broken_points(scene, run, capsys):
    xyz = points()
    xyz[6, 0], xyz[7, 2], xyz[8, 1], xyz[9, 2] = 1e39, 1e39, -1e39, 1e39
    run(scene(**{"points/xyz": xyz}), iterations=10)
    # The one at z = 1e39 m lies in the middle of the picture.
    assert "37 of 40 points" in capsys.readouterr().err


@pytest.mark.numerics("no point; no visible point", outside="one in each cell of a picture, at any depth")
@pytest.mark.parametrize("xyz", [points(0), points(5) - [0, 0, 9]])
def test_no_points(scene, run, capsys, xyz):
    run(scene(**{"points/xyz": xyz, "points/rgb": colors(len(xyz))}), iterations=10)
    assert re.search("[1-9][0-9]* points added", capsys.readouterr().err)


@pytest.mark.numerics("one point; 40 points at one place", outside="Gaussian of 0.1 m; of 0.3 mm")
@pytest.mark.parametrize("count", [1, 40])
def test_points_in_one_place(scene, run, count):
    xyz = np.tile([[0.0, 0.0, 2.0]], (count, 1))
    made = run(scene(**{"points/xyz": xyz, "points/rgb": colors(count)}))
    assert np.isfinite(made.read("curve/loss")).all() and made.read("curve/loss")[-1] < 1


@pytest.mark.numerics("training on pictures of one color: black, grey, white", outside="trains, finite loss")
@pytest.mark.parametrize("color", [0, 128, 255])
def test_pictures_of_one_color(scene, run, color):
    made = run(scene(rgb=np.full((FRAMES, SIZE, SIZE, 3), color, np.uint8)))
    loss = made.read("curve/loss")
    assert np.isfinite(loss).all() and loss[-1] < loss[0] and (made.read("held_out/psnr") > 0).all()


@pytest.mark.numerics("training frame with all pixels masked", outside="does not count")
def test_one_frame_masked(scene, run):
    probability = np.zeros((FRAMES, SIZE, SIZE), np.float16)
    probability[0] = 1.0
    made = run(scene(probability=probability), masking="initial", iterations=60)
    assert np.isfinite(made.read("curve/loss")).all()


@pytest.mark.numerics(
    "held-out frames, some without a pixel", within=1e-12, outside="mean PSNR of the others"
)
def test_mean_psnr(measured):
    measured(abs(mean_known(np.array([30.0, np.nan, 20.0])) - 25.0))
    assert np.isnan(mean_known(np.full(2, np.nan)))


@pytest.mark.numerics("renders that are always NaN", outside="UserError after 30 iterations, with a remedy")
def test_renders_that_stay_broken(scene, run, left, monkeypatch):
    monkeypatch.setattr(objective, "l1_ssim", lambda image, *_: image.mean() * float("nan"))
    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 1e-9)
    folder = scene()
    with pytest.raises(UserError, match="30 .*near_plane"):
        run(folder)
    assert not left(folder)


@pytest.mark.numerics("NaN render in one iteration of 40", outside="step skipped")
def test_a_render_that_is_broken_once(scene, run, monkeypatch):
    real, calls = objective.l1_ssim, []

    def once(image, *rest):
        calls.append(0)
        return real(image, *rest) * (float("nan") if len(calls) == 15 else 1.0)

    monkeypatch.setattr(objective, "l1_ssim", once)
    made = run(scene())
    loss = made.read("curve/loss")
    assert np.isnan(loss).tolist() == [False, True, False, False] and loss[-1] < loss[0]
    assert made.facts["skipped_rows"] > 0


@pytest.mark.numerics("NaN or infinite Gaussians at the start", outside="culled, pruned, never stored")
def test_broken_gaussians(scene, run, monkeypatch):
    real = state.starting_gaussians

    def broken(*args, **keys) -> Gaussians:
        start = real(*args, **keys)
        for row, name in enumerate(("means", "quats", "log_scales", "logit_opacities", "sh")):
            getattr(start, name)[2 * row] = float("nan")
            getattr(start, name)[2 * row + 1] = float("inf")
        return start

    monkeypatch.setattr(state, "starting_gaussians", broken)
    loss = run(scene()).read("curve/loss")
    assert np.isfinite(loss[1:]).all() and loss[-1] < loss[1]
    # Too short a run for density control to find them.
    assert run(scene(), iterations=2).shape("means")[0] <= 60 - 10


@pytest.mark.numerics("no finite Gaussian", outside="UserError; no artifact")
def test_no_finite_gaussian(scene, run, left, monkeypatch):
    real = state.starting_gaussians
    monkeypatch.setattr(
        state,
        "starting_gaussians",
        lambda *args, **keys: replace(start := real(*args, **keys), means=start.means * float("nan")),
    )
    folder = scene()
    with pytest.raises(UserError, match="Gaussian"):
        run(folder, iterations=20)
    assert not left(folder)


@pytest.mark.numerics(
    "learning rates of positions times 100 and 1e4; all times 100",
    outside="trains, or UserError with the reason",
)
@pytest.mark.parametrize(("positions", "others"), [(100, 1), (10_000, 1), (100, 100)])
def test_learning_rates(scene, run, left, monkeypatch, positions, others):
    ends = {"position_lr_init": 1.6e-4 * positions, "position_lr_final": 1.6e-6 * positions}

    def rates(means: float) -> LearningRates:
        return LearningRates(**{name: others * rate for name, rate in asdict(LearningRates(means)).items()})

    monkeypatch.setattr(schedule, "STOCK", replace(schedule.STOCK, **ends))
    monkeypatch.setattr(state, "LearningRates", rates)
    folder = scene()
    try:
        run(folder, iterations=80 if others > 1 else 40)
    except UserError as error:
        assert "Gaussians" in str(error) or "diverged" in str(error)
        assert not left(folder)


@pytest.mark.numerics(
    "loss of a scene 100 and 5e3 m from the origin, against one at the origin",
    within=0.02,
    outside="UserError if float32 does not resolve 1/1000 of the scene (1 m: beyond 16 km)",
)
def test_far_from_the_origin(scene, run, measured):
    losses = []
    for far in (0.0, 100.0, 5e3):
        offset = np.array([far, -far, 0.5 * far])
        changes = in_unit(1.0)
        changes["camera_to_world"][:, :3, 3] += offset
        changes["points/xyz"] += offset
        losses.append(run(scene(**changes), iterations=20).read("curve/loss")[-1])
        measured(abs(losses[-1] - losses[0]) / losses[0])


@pytest.mark.numerics("scene 1e6 m from the origin", outside="UserError: move the origin")
@pytest.mark.parametrize("far", [2e4, 1e6])
def test_too_far_from_the_origin(scene, run, left, far):
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 1, 3] = far
    folder = scene(**{"camera_to_world": poses, "points/xyz": points() + [0, far, 0]})
    with pytest.raises(UserError, match="origin"):
        run(folder)
    assert not left(folder)


@pytest.mark.numerics(
    "loss in units of 1e-6 to 1e6 m with corrected poses, against meters",
    within=0.02,
    outside="near plane in proportion, else UserError names run.near_plane",
)
def test_units(scene, run, measured):
    losses = []
    for unit in (1.0, 1e-6, 1e-3, 1e3, 1e6):
        made = run(scene(**in_unit(unit)), near_plane=0.1 * unit, refine_poses="on", iterations=20)
        losses.append(made.read("curve/loss")[-1])
        assert made.facts["extent_m"] == pytest.approx(unit)
        measured(abs(losses[-1] - losses[0]) / losses[0])


@pytest.mark.numerics(
    "most points before the near plane or beyond the far plane",
    outside="UserError names run.near_plane, and poses.meters_per_unit of known poses",
)
@pytest.mark.parametrize("unit", [1e-3, 1e10])
@pytest.mark.parametrize("known", [False, True])
def test_units_that_the_renderer_does_not_reach(scene, run, left, unit, known):
    notes = {"notes": {"source": "known", "file": "transforms.json", "scale": "arbitrary"}} if known else {}
    folder = scene(facts=notes, **in_unit(unit))
    keys = ["run.near_plane = 0.1", *(["poses.meters_per_unit"] if known else [])]
    with pytest.raises(UserError, match=".*\n?.*".join(keys)):
        run(folder)
    assert not left(folder)


@pytest.mark.numerics("frames below 11 px high", outside="trains; SSIM is NaN")
@pytest.mark.parametrize("height", [1, 5, 10])
def test_small_pictures(scene, run, height):
    intrinsics = np.array([[18.0, 0, 10], [0, 18.0, height / 2], [0, 0, 1]])
    rgb, valid = np.full((FRAMES, height, SIZE, 3), 90, np.uint8), np.ones((height, SIZE), bool)
    trained = run(scene(rgb=rgb, valid=valid, intrinsics=intrinsics))
    assert np.isnan(trained.read("held_out/ssim")).all()
    assert np.isfinite(trained.read("held_out/psnr")).all()


@pytest.mark.numerics("one training frame; one registered frame", outside="trains")
def test_one_frame(scene, run):
    registered = np.arange(FRAMES) == 1
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[~registered] = np.nan
    made = run(scene(registered=registered, camera_to_world=poses))
    assert made.facts["views"] == {"training": 1, "held out": 0} and made.facts["extent_m"] == 1.0


@pytest.mark.numerics("NaN in the code weights of the joint loss", outside="weight 0")
def test_broken_weights_of_codes():
    transient = torch.zeros(4, 5, dtype=torch.float16)
    transient[1, 2] = float("nan")
    targets = Targets(torch.ones(1, 3, 4, 5), torch.ones(1, 4, 5, dtype=torch.bool))
    rendered = torch.zeros(1, 3, 4, 5, requires_grad=True)
    loss = code_l1(rendered, targets, pixel_weight(None, transient))
    loss.backward()
    assert loss.item() == pytest.approx(19 / 20) and rendered.grad.isfinite().all()
