"""Stage language writes a complete artifact for each method and checks its inputs."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.language import dominant, joint, stage
from egosplat.language.decoder import Decoder, read_decoder
from egosplat.language.method import Coded, Method
from egosplat.language.views import CodeViews
from egosplat.pipeline.config import defaults, stage_values
from egosplat.pipeline.stages import code_of
from egosplat.splats import stage as splats_stage
from tests.unit.language.conftest import CLUSTERED

KEYS = stage_values("language", defaults()) | {"iterations": 20, "lr": 0.02}
SPLATS = defaults()["camera"] | defaults()["splats"]
SPLATS |= {"iterations": 20, "max_gaussians": 300, "evaluate_every": 20, "sh_degree": 0, "masking": "none"}
GEOMETRY = "geometry shared, of 20 iterations"


@pytest.fixture
def trained(scene):
    """``trained(**changes)``: the folder of the scene with splats."""

    def make(**changes: object) -> Path:
        folder = scene()
        names = ("masks", "transient", "instances", "features")
        paths = {f"{name}_path": folder / f"{name}.zarr" for name in names}
        needed = (folder / f"{name}.zarr" for name in ("frames", "poses", "splats"))
        splats_stage.run(*needed, splats_stage.SplatsOptions(**SPLATS | changes), **paths)
        return folder

    return make


def run(folder: Path, name: str = "language.zarr", masks: bool = True, survey=None, **changes: object):
    """The verified artifact."""
    inputs = [folder / f"{kind}.zarr" for kind in ("frames", "poses", "splats")]
    learnt = {f"{kind}_path": folder / f"{kind}.zarr" for kind in ("instances", "features")}
    moving = {f"{kind}_path": folder / f"{kind}.zarr" if masks else None for kind in ("masks", "transient")}
    options = stage.LanguageOptions(**KEYS | changes)
    stage.run(*inputs, folder / name, options, survey_path=survey, **learnt, **moving)
    return verify(folder / name, SCHEMAS)


def test_artifact_holds_the_expected_facts_and_inputs(trained):
    found = run(trained(masking="refined"))
    inputs = {f"{name}.zarr" for name in ("frames", "poses", "instances", "features", "splats", "masks")}
    assert found.origin == "synthetic" and set(found.provenance["inputs"]) == inputs
    assert found.provenance["code"] == code_of("language", "lifted")
    facts = {"levels": ["part", "whole"], "method": "lifted", "maps_only": False, "views": 4}
    assert found.facts == facts | {"stands_in": [GEOMETRY]}
    assert found.shape("code")[1:] == (2, 3) and found.shape("curve/loss") == (0,)
    assert not found.read("code")[found.read("share") == 0].any()


@pytest.mark.parametrize("language", ["after", "joint"])
def test_codes_are_lifted_with_the_poses_that_training_refined(trained, monkeypatch, language):
    used: list[CodeViews] = []
    watched = lambda lift: lambda views, *others: used.append(views) or lift(views, *others)
    monkeypatch.setattr(dominant, "METHOD", Method(watched(dominant.lift_instances)))
    monkeypatch.setattr(joint, "shares", watched(joint.shares))
    folder = trained(refine_poses="on", compensate_exposure="on", language=language)
    run(folder)
    views, splats = used[-1], verify(folder / "splats.zarr", SCHEMAS)
    refined = splats.read("corrections/camera_to_world")
    np.testing.assert_array_equal(views.camera_to_world, refined[views.frame])
    assert np.linalg.norm(splats.read("corrections/shift")[views.frame], axis=1).min() > 0.0


def test_what_found_the_masks_is_told(trained):
    folder = trained()
    classical = "a classical segmenter"
    for segmenter, method, told in (
        ("sam2", "center", "SAM2 in place of SAM"),
        ("classical", "center", f"{classical} in place of SAM"),
        ("classical", "projected", f"{classical} + OpenCLIP features in place of OpenSeg"),
    ):
        found = run(folder, method=method, segmenter=segmenter)
        assert found.facts["stands_in"] == [told, GEOMETRY]


def test_a_method_s_own_decoder_and_stand_ins_are_stored_and_decode_the_scene(trained, monkeypatch):
    own = Decoder((3, 4), np.arange(16, dtype=np.float32), ("none",), unit_input=True)

    def learned(views, targets, options, checkpoint):
        plain = dominant.lift_instances(views, targets)
        return Coded(plain.code, plain.share, plain.levels, own, stands_in=("sand in place of water",))

    folder = trained()
    without = run(folder)
    monkeypatch.setattr(dominant, "METHOD", Method(learned))
    found = run(folder, "learned.zarr")
    assert found.facts["stands_in"] == ["sand in place of water", GEOMETRY]
    decoder = read_decoder(found)
    assert vars(decoder) | {"values": None} == vars(own) | {"values": None}
    np.testing.assert_array_equal(decoder.values, own.values)
    assert not without.has("decoder/values")


def test_frames_left_out_by_the_survey_are_not_used(trained, survey_that_keeps):
    folder = trained()
    found = run(folder, survey=survey_that_keeps(folder, [0, 1]))
    assert found.facts["views"] < run(folder, "all.zarr").facts["views"] == 4
    assert "kept_frames" in found.provenance["options"]


@pytest.mark.parametrize("method", ["lifted", "trained", "projected", "center", CLUSTERED])
def test_equal_runs_are_equal_and_leave_no_other_files(trained, method):
    folder = trained()
    before = {path.name for path in folder.iterdir()}
    assert run(folder, method=method).digest == run(folder, "again.zarr", method=method).digest
    assert {path.name for path in folder.iterdir()} - before == {"language.zarr", "again.zarr"}


def test_joint_codes_are_rendered_in_queries_as_they_were_in_training(trained):
    """They are not normalized: codes of another norm would be composited with other weights."""
    folder = trained(language="joint")
    stored = verify(folder / "splats.zarr", SCHEMAS).read("features")
    found = run(folder, "unit.zarr")
    taught = found.read("share") > 0
    code = found.read("code")[taught]
    assert found.facts["method"] == "joint" and taught.any()
    assert np.array_equal(code, stored.reshape(found.shape("code"))[taught])
    norms = np.linalg.norm(code, axis=-1)
    assert (abs(norms[norms > 0] - 1) > 1e-3).any()


def test_joint_codes_of_other_features_are_rejected(scene, trained):
    folder = trained(language="joint")
    splats = (folder / "splats.zarr").rename(folder / "kept")
    for path in folder.glob("*.zarr"):
        shutil.rmtree(path)
    scene(rows=[(0, 0), (1, 0)])
    splats.rename(folder / "splats.zarr")
    with pytest.raises(UserError, match="another features.zarr"):
        run(folder)


def test_masks_are_those_of_the_splats_and_must_be_there(trained):
    with pytest.raises(UserError, match="--masks"):
        run(trained(masking="refined"), masks=False)
    assert "transient.zarr" in run(trained(masking="initial")).provenance["inputs"]


def test_joint_training_needs_segments_and_features(scene):
    paths = (scene() / f"{name}.zarr" for name in ("frames", "poses", "s"))
    with pytest.raises(UserError, match="--instances.*--features"):
        splats_stage.run(*paths, splats_stage.SplatsOptions(**SPLATS | {"language": "joint"}))
