"""Stage splats writes a complete artifact, resumes identically, and reports user errors."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import FITTED, FRAMES, POSES, SCHEMAS, TRAINED, camera_poses
from egosplat.errors import UserError
from egosplat.gaussians.model import PARAMETERS
from egosplat.splats import stage
from tests.support.gaussian_scene import Stopped, StoppingCheckpoint
from tests.support.scenes import put

KEYS = {"masking": "none", "iterations": 40, "max_gaussians": 60, "evaluate_every": 20, "sh_degree": 1}


def run(folder: Path, name: str = "splats.zarr", survey: Path | None = None, **changes: object):
    """The verified artifact."""
    options = stage.SplatsOptions(**KEYS | changes)
    stage.run(folder / "frames.zarr", folder / "poses.zarr", folder / name, options, survey_path=survey)
    return verify(folder / name, SCHEMAS)


def test_artifact_holds_the_expected_facts_and_inputs(scene, pictures):
    splats = run(scene())
    assert splats.origin == "synthetic" and set(splats.provenance["inputs"]) == {"frames.zarr", "poses.zarr"}
    assert splats.facts["views"] == {"training": 8, "held out": 1}
    assert splats.facts["iteration"] == 40
    assert len(splats.facts["history_s"]) == 2
    assert splats.read("held_out/frame").tolist() == [4]
    assert splats.read("history/psnr")[-1] == pytest.approx(splats.read("held_out/psnr").mean())
    assert splats.read("curve/gaussians")[-1] == splats.shape("means")[0]
    error = np.abs(splats.row("held_out/render", 0).astype(float) - pictures[4]) / 255
    assert -10 * np.log10((error**2).mean()) == pytest.approx(splats.read("held_out/psnr")[0], abs=0.1)


def test_frames_left_out_by_the_survey_are_not_trained_on(scene, pictures, survey_that_keeps):
    folder = scene()
    survey = survey_that_keeps(folder, [0, 2, 4, 6, 8])
    splats = run(folder, survey=survey)
    assert splats.facts["views"] == {"training": 4, "held out": 1}
    assert splats.provenance["options"]["kept_frames"] == json.loads(survey.read_text())["views"]["digest"]
    blank = pictures.copy()
    blank[[1, 3, 5, 7]] = 0
    survey_that_keeps(scene(rgb=blank), [0, 2, 4, 6, 8])
    assert run(folder, "other.zarr", survey=survey).digest == splats.digest


def test_a_static_scene_trains_on_all_frames_but_with_masks_on_the_kept_ones(scene, survey_that_keeps):
    folder = scene()
    survey = survey_that_keeps(folder, [0, 2, 4, 6, 8], static=True)
    still = run(folder, survey=survey)
    assert still.digest == run(folder, "all.zarr").digest
    assert still.facts["views"]["training"] == 8 and "kept_frames" not in still.provenance["options"]
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    for masking, number in (("none", 9), ("initial", 5), ("refined", 5)):
        assert kept_frames(frames, survey, masking)[0].sum() == number


@pytest.mark.parametrize("source", [None, __file__])
def test_masking_auto_needs_the_survey(scene, source):
    folder = scene()
    with pytest.raises(UserError, match="splats.masking = auto.*none or refined"):
        run(folder, masking="auto", source=source)
    assert not (folder / "splats.zarr").exists()


@pytest.mark.parametrize("hides", [True, False])
def test_masks_that_leave_no_pixel_are_named(scene, pictures, hides):
    folder = scene(masked=np.full(pictures.shape[:3], hides))
    put(folder, "masks", {"refined": np.ones(pictures.shape[:3], bool)}, made_from=["frames"])
    named = "frames.zarr: .*dynamic_mask_" if hides else "^splats.masking leaves no pixel.*masks.threshold"
    options = stage.SplatsOptions(**KEYS | {"masking": "refined"})
    paths = (folder / f"{name}.zarr" for name in ("frames", "poses", "splats"))
    with pytest.raises(UserError, match=named):
        stage.run(*paths, options, masks_path=folder / "masks.zarr")


def test_a_killed_run_resumes_to_the_same_gaussians_if_its_options_are_the_same(scene, monkeypatch, capsys):
    folder, keys = scene(), {"recipe": "paper"}
    unbroken = {seed: run(folder, f"{seed}.zarr", seed=seed, **keys).digest for seed in (0, 7)}
    written = folder / ".splats.zarr.checkpoint" / "state"
    for seed in (7, 0):
        with monkeypatch.context() as patch, pytest.raises(Stopped):
            patch.setattr(stage, "Checkpoint", partial(StoppingCheckpoint, at=30))
            run(folder, seed=0, **keys)
        assert written.exists() and capsys.readouterr()
        assert run(folder, seed=seed, **keys).digest == unbroken[seed]
        assert ("training resumes after iteration 30" in capsys.readouterr().err) == (seed == 0)
        assert not written.parent.exists()


def test_without_held_out_frames_there_are_no_scores(scene):
    splats = run(scene(train=np.ones(9, bool)))
    assert splats.shape("held_out/render") == (0, 24, 24, 3) and not len(splats.read("held_out/psnr"))
    assert np.isnan(splats.read("history/psnr")).all()


def test_training_without_poses_is_an_error(scene):
    folder = scene(registered=np.arange(9) == 4)
    with pytest.raises(UserError, match="8 training frames"):
        run(folder)
    assert {path.name for path in folder.iterdir()} == {"frames.zarr", "poses.zarr"}


def test_corrections_are_written_beside_the_scores_without(scene, camera_to_world, pictures):
    wrong = camera_to_world.copy()
    wrong[:, 0, 3] += np.where(np.arange(9) % 2, 0.05, -0.05)
    keys = {"refine_poses": "on", "compensate_exposure": "on", "iterations": 200}
    folder = scene(camera_to_world=wrong)
    splats = run(folder, **keys)
    poses = open_artifact(folder / "poses.zarr", POSES)
    assert splats.read("corrections/source").tolist() == [TRAINED] * 4 + [FITTED] + [TRAINED] * 4
    found = camera_poses(poses, splats)
    moved = np.linalg.norm(found[:, :3, 3] - wrong[:, :3, 3], axis=1)
    np.testing.assert_allclose(np.linalg.norm(splats.read("corrections/shift"), axis=1), moved, atol=1e-12)
    assert (moved > 1e-3).all() and splats.read("corrections/gain").shape == (9, 3)
    assert splats.read("held_out/psnr")[0] > splats.read("held_out/psnr_given")[0] + 1.0
    assert np.isfinite(splats.read("corrections/turn")).all() and splats.facts["scene_depth"] > 1.0
    # Another held-out photograph changes its own fit and no other bit.
    other = pictures.copy()
    other[4] //= 2
    again = run(scene(camera_to_world=wrong, rgb=other), "other.zarr", **keys)
    for name in (*PARAMETERS, "curve/loss"):
        np.testing.assert_array_equal(again.read(name), splats.read(name))
    others = np.arange(9) != 4
    np.testing.assert_array_equal(camera_poses(poses, again)[others], found[others])
    assert again.read("corrections/gain")[4].max() < 0.8 * splats.read("corrections/gain")[4].min()
