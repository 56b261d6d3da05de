"""Stage transient writes a complete artifact, resumes identically, and reports user errors."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.gaussians import trainer
from egosplat.transient import stage
from egosplat.transient.network import make_network
from tests.support.gaussian_scene import Stopped, StoppingCheckpoint

KEYS = {"iterations": 12, "input_size": 64, "resolution": 32}


def run(folder: Path, name: str = "transient.zarr", survey: Path | None = None, **changes: object):
    """The verified artifact."""
    options = stage.TransientOptions(**KEYS | changes)
    stage.run(folder / "frames.zarr", folder / "poses.zarr", folder / name, options, survey_path=survey)
    return verify(folder / name, SCHEMAS)


def test_artifact_holds_the_expected_facts_and_inputs_and_the_network(scene):
    folder = scene(registered=np.arange(6) != 5)
    transient = run(folder, recipe="paper")
    assert transient.origin == "synthetic"
    assert set(transient.provenance["inputs"]) == {"frames.zarr", "poses.zarr"}
    assert transient.facts["views"] == 4 and transient.facts["working_size"] == [32, 32]
    assert transient.read("curve/iteration").tolist() == [10, 12]
    probability = transient.read("probability")
    assert probability.shape == (6, 32, 32) and ((probability >= 0) & (probability <= 1)).all()
    assert transient.facts["mean_probability"] == pytest.approx(probability.astype(float).mean(), abs=1e-3)
    # The frame without a pose too.
    assert probability[5].std() > 0
    net, values = make_network(64, False, None, 9).eval(), torch.from_numpy(transient.read("weights"))
    sizes = [int(np.prod(shape)) for _, shape in transient.facts["tensors"]]
    parts = zip(transient.facts["tensors"], values.split(sizes), strict=True)
    missing = net.load_state_dict({name: part.view(shape) for (name, shape), part in parts}, strict=False)
    assert all(name.endswith("num_batches_tracked") for name in missing.missing_keys)
    picture = torch.from_numpy(verify(folder / "frames.zarr", SCHEMAS).row("rgb", 2)).float() / 255
    assert net(picture, 32, 32).detach().numpy() == pytest.approx(probability[2], abs=1e-3)


def test_frames_left_out_by_the_survey_are_predicted_but_not_trained_on(scene, pictures, survey_that_keeps):
    folder = scene()
    survey = survey_that_keeps(folder, [0, 2, 4])
    transient = run(folder, survey=survey)
    assert transient.facts["views"] == 3 and transient.shape("probability")[0] == 6
    assert "kept_frames" in transient.provenance["options"]
    blank = pictures.copy()
    blank[[1, 3, 5]] = 0
    other = scene(rgb=blank)
    survey_that_keeps(other, [0, 2, 4])
    again = run(other, "other.zarr", survey=survey)
    assert np.array_equal(again.read("weights"), transient.read("weights"))
    assert not np.array_equal(run(other, "all.zarr").read("weights"), transient.read("weights"))


def test_poses_and_exposure_are_corrected_here_too(scene):
    folder, weights = scene(), []
    for poses, exposure in (("off", "off"), ("auto", "auto"), ("on", "off"), ("off", "on")):
        found = run(folder, f"{poses}_{exposure}.zarr", refine_poses=poses, compensate_exposure=exposure)
        weights.append(found.read("weights"))
    assert np.array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2]) and not np.array_equal(weights[0], weights[3])


def test_a_killed_run_resumes_to_the_same_result(scene, monkeypatch, capsys):
    folder = scene()
    expected = run(folder, "unbroken.zarr").digest
    with monkeypatch.context() as patch, pytest.raises(Stopped):
        patch.setattr(stage, "Checkpoint", partial(StoppingCheckpoint, at=10))
        run(folder)
    assert run(folder).digest == expected
    assert "resumes after iteration 10" in capsys.readouterr().err
    assert not (folder / ".transient.zarr.checkpoint").exists()


def test_it_trains_on_one_thread_so_that_it_repeats(scene, monkeypatch):
    train, threads = trainer.resume_and_train, []
    noted = lambda *arguments: threads.append(torch.get_num_threads()) or train(*arguments)
    monkeypatch.setattr(trainer, "resume_and_train", noted)
    torch.set_num_threads(2)
    run(scene(), iterations=1)
    assert threads == [1] and torch.get_num_threads() == 2


def test_pictures_of_the_sensor_are_turned_upright(scene):
    lying, upright = (
        run(scene(facts={"format": "adt", "upright": turned}), iterations=1, warmup=1.0).read("probability")
        for turned in (False, True)
    )
    assert (lying != upright).any()


def test_a_missing_checkpoint_is_named(scene):
    with pytest.raises(UserError, match="transient.encoder_weights: .*nowhere.pt"):
        run(scene(), encoder_weights="nowhere.pt")
