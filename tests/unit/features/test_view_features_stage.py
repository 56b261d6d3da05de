"""Stage view_features encodes the same features in any batch size, after a kill, and without bad views."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.features import view_features_stage as stage
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip

KEYS = {"min_area": 0.0, "max_views": None}


@pytest.fixture
def run(clip_keys, monkeypatch):
    """``run(folder, name=, batch=)``: the verified artifact."""

    def call(folder: Path, name: str = "view_features.zarr", batch: int = 4):
        monkeypatch.setattr(stage, "BATCH", batch)
        paths = [folder / each for each in ("frames.zarr", "instances.zarr", name)]
        stage.run(*paths, stage.ViewFeaturesOptions(**KEYS | clip_keys))
        return verify(folder / name, SCHEMAS)

    return call


def test_artifact_holds_the_expected_facts_and_open_clip_s_own_features(scene, run, clip_keys):
    from open_clip.transform import PreprocessCfg, image_transform_v2

    folder = scene()
    views = run(folder)
    assert views.origin == "synthetic" and {*views.provenance["inputs"]} == {"frames.zarr", "instances.zarr"}
    assert views.read("instance").tolist() == [0] * 4 + [1] * 4 + [2, 3]
    assert views.read("frame").tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 2, 3]
    assert views.read("instances/level").tolist() == [0, 0, 1, 1, 0]
    assert views.read("feature").shape == (10, 8)
    np.testing.assert_allclose(np.linalg.norm(views.read("feature"), axis=1), 1.0, rtol=1e-6)
    assert views.facts["levels"] == ["part", "whole"] and not views.facts["turned"]
    clip = views.facts["clip"]
    assert views.provenance["models"] == {"clip_checkpoint": model_hash(CLIP, clip_keys)}
    assert clip["model"] == clip_keys["clip_model"] and len(clip["hash"]) == 16 and not clip["small"]
    clip = load_open_clip(*clip_keys.values())
    looks = {"mean": (0.5, 0.4, 0.3), "interpolation": "bilinear", "resize_mode": "squash"}
    prepare = image_transform_v2(PreprocessCfg(size=(32, 32), **looks), False)
    rgb = open_artifact(folder / "frames.zarr", SCHEMAS["frames"]).row("rgb", 2)
    square = np.zeros((11, 11, 3), np.uint8)
    square[2:9] = rgb[2:9, 6:17]
    with clip.compute.inference():
        expected = clip.model.encode_image(prepare(Image.fromarray(square))[None], normalize=True)[0].numpy()
    np.testing.assert_allclose(views.read("feature")[2], expected, atol=1e-6)


def test_batches_run_across_frames_and_change_nothing(scene, run):
    folder = scene()
    expected = run(folder).read("feature")
    for batch in (1, 3, 100):
        found = run(folder, "other.zarr", batch=batch).read("feature")
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_jobs_of_chunks_give_the_same_artifact(scene, run, clip_keys, monkeypatch):
    """Batches of two end with a chunk of three frames, in one job as well."""
    monkeypatch.setattr("egosplat.pipeline.chunks.CHUNK_FRAMES", 3)
    folder = scene()
    whole = run(folder, "whole.zarr", batch=2)
    paths = [folder / "frames.zarr", folder / "instances.zarr"]
    options = stage.ViewFeaturesOptions(**KEYS | clip_keys)
    files = [folder / f"view_features.{number}.chunk" for number in (1, 2)]
    for number, file in enumerate(files, 1):
        stage.run(*paths, file, options, chunk=number)
    stage.run(*paths, folder / "view_features.zarr", options, gather=files)
    gathered = verify(folder / "view_features.zarr", SCHEMAS)
    assert gathered.digest == whole.digest and gathered.facts == whole.facts
    with pytest.raises(UserError, match=r"view_features\.max_views"):
        stage.run(*paths, files[0], options.change(max_views=1), chunk=1)


def test_a_killed_run_resumes_to_the_same_features(scene, run, monkeypatch, capsys):
    folder, encode, done = scene(), stage.encode, []
    expected = run(folder, "unbroken.zarr", batch=2).digest

    def mortal(clip, crops):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(1)
        return encode(clip, crops)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(stage, "encode", mortal)
        patch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
        run(folder, batch=2)
    assert not (folder / "view_features.zarr").exists()
    capsys.readouterr()
    assert run(folder, batch=2).digest == expected
    assert "encoding crops resumes after 3 of 5 steps" in capsys.readouterr().err
    names = {"frames.zarr", "instances.zarr", "view_features.zarr", "unbroken.zarr"}
    assert {path.name for path in folder.iterdir()} == names


def test_progress_with_other_options_is_not_reused(scene, run, monkeypatch):
    folder = scene()
    expected = run(folder, "fresh.zarr", batch=2).digest
    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
    monkeypatch.setattr("egosplat.artifacts.checkpoint.Checkpoint.remove", lambda self: None)
    run(folder, batch=1)
    assert (folder / ".view_features.zarr.checkpoint" / "state").exists()
    assert run(folder, batch=2).digest == expected


@pytest.mark.parametrize(
    "level, shape", [((), (5, 1, 40, 40)), ((0, 0), (5, 2, 40, 40)), ((), (5, 0, 40, 40))]
)
def test_no_views_give_an_empty_artifact(scene, run, level, shape):
    views = run(scene(labels=np.full(shape, -1, np.int32), level=level))
    assert views.shape("feature") == (0, 8) and views.shape("instances/level") == (len(level),)


def test_views_without_a_feature_are_left_out_and_reported(scene, run, monkeypatch, capsys):
    encode = stage.encode

    def spoiled(clip, crops):
        features = encode(clip, crops)
        features[0] = np.nan
        return features

    folder = scene()
    whole = run(folder, "whole.zarr").read("feature")
    monkeypatch.setattr(stage, "encode", spoiled)
    views = run(folder)
    assert views.facts["without_feature"] == 3 and views.shape("feature") == (7, 8)
    assert np.isfinite(views.read("feature")).all()
    assert all((row == whole).all(axis=1).any() for row in views.read("feature"))
    assert "3 of 10 views" in capsys.readouterr().err
    monkeypatch.setattr(stage, "encode", lambda clip, crops: np.full((len(crops), 8), np.nan, np.float32))
    with pytest.raises(UserError, match="models.clip_checkpoint"):
        run(folder, "none.zarr")
    assert not (folder / "none.zarr").exists()


def test_segments_of_other_frames_are_rejected(scene, run, labels):
    folder = scene()
    instances = (folder / "instances.zarr").rename(folder / "kept.zarr")
    scene(labels=labels[:4], train=np.ones(4, bool))
    shutil.rmtree(folder / "instances.zarr")
    instances.rename(folder / "instances.zarr")
    with pytest.raises(UserError, match="instances.zarr: was made from another frames.zarr"):
        run(folder)
    assert {path.name for path in folder.iterdir()} == {"frames.zarr", "instances.zarr"}
