"""Stage histories on a small scene: a blue square that lies left on a wall, is carried, and lies right."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.render import render
from egosplat.histories.options import HistoriesOptions
from egosplat.histories.stage import _features_of_carries, run
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.text import encode_phrases
from tests.support.gaussian_scene import photographs
from tests.support.page_scene import CAMERA, SETTINGS, wall
from tests.support.scenes import camera_facts, put

# A tenth of a second each: at rest on the left, on the way, at rest on the right.
COUNT, LEFT, RIGHT, HALF = 60, 24, 72, 5
COLUMNS = np.concatenate([np.full(25, LEFT), np.linspace(LEFT, RIGHT, 12)[1:-1], np.full(25, RIGHT)]).round()
BLUE = (30, 60, 220)
SMALL = {"clip_model": "small", "clip_checkpoint": "small"}
INPUTS = ("frames", "poses", "instances", "view_features", "splats")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with what the stage reads."""
    folder, side, gaussians = tmp_path_factory.mktemp("histories"), CAMERA.width, wall()
    rgb = np.tile(photographs(gaussians, np.eye(4)[None], CAMERA), (COUNT, 1, 1, 1))
    labels = np.full((COUNT, 1, side, side), -1, np.int32)
    for frame, column in enumerate(COLUMNS.astype(int)):
        part = np.s_[frame, 48 - HALF : 48 + HALF, column - HALF : column + HALF]
        rgb[part] = BLUE
        labels[:, 0][part] = 0
    facts = camera_facts(CAMERA)
    put(folder, "frames", {"rgb": rgb, "train": np.arange(COUNT) % 10 != 5}, facts)
    arrays = {"registered": np.ones(COUNT, bool), "intrinsics": CAMERA.matrix}
    put(folder, "poses", arrays, facts, made_from=["frames"])
    arrays = {"labels": labels, "instances/level": np.zeros(1, np.int8), "instances/moving": np.array([True])}
    about = {"levels": ["whole"], "source": "masks", "instances": {"whole": 1}}
    put(folder, "instances", arrays, about, made_from=["frames"])
    clip = {"model": "small", "checkpoint": "small", "hash": model_hash(CLIP, SMALL)}
    cup = encode_phrases(load_open_clip("small", "small", "cpu", "float32"), ["cup"]).numpy()
    arrays = {"feature": cup, "instances/level": np.zeros(1, np.int8)}
    about = {"levels": ["whole"], "clip": clip}
    put(folder, "view_features", arrays, about, made_from=["frames", "instances"])
    stored = {name: getattr(gaussians, name).numpy() for name in PARAMETERS if name != "features"}
    about = {"camera": asdict(CAMERA), "sh_degree_in_use": 1, "views": {"training": COUNT}}
    put(folder, "splats", stored, about, options=asdict(SETTINGS), made_from=["frames", "poses"])
    return folder


def learn(folder, output):
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in INPUTS}
    run(**paths, output=output, options=HistoriesOptions())
    return verify(output, SCHEMAS)


@pytest.fixture(scope="module")
def found(made):
    return learn(made, made / "histories.zarr")


def test_a_square_is_carried_from_left_to_right(found):
    np.testing.assert_allclose(found.read("carries/start"), [[-0.8, 0, 2]], atol=0.06)
    np.testing.assert_allclose(found.read("carries/end"), [[0.8, 0, 2]], atol=0.06)
    spans = [found.read(f"carries/{name}_frame")[0] for name in ("first", "last")]
    np.testing.assert_allclose(spans, [25, 34], atol=4)
    assert found.read("carries/size")[0] == pytest.approx(1 / 3, rel=0.05)
    frame, box = found.read("carries/best_frame")[0], found.read("carries/box")[0]
    assert box.tolist() == [COLUMNS[frame] - HALF, 48 - HALF, COLUMNS[frame] + HALF, 48 + HALF]


def test_a_thing_rests_before_and_after_its_carry(found):
    assert found.shape("rests/center") == (2, 3)
    np.testing.assert_allclose(found.read("rests/center")[:, 0], [-0.8, 0.8], atol=0.1)
    first, last = found.read("rests/from_frame"), found.read("rests/until_frame")
    np.testing.assert_allclose([*first, *last], [0, 35, 24, 59], atol=2)
    assert (found.read("rests/gain") > 0.3).all()
    # Both are one thing with one feature.
    assert found.read("rests/thing").tolist() == [0, 0] and found.read("carries/thing").tolist() == [0]
    assert [found.read(f"carries/{name}_rest").tolist() for name in ("from", "to")] == [[0], [1]]
    np.testing.assert_allclose(np.linalg.norm(found.read("things/feature"), axis=1), 1.0, rtol=1e-5)


def test_the_scene_at_a_time_shows_the_thing_where_it_lies(made, found):
    own = torch.from_numpy(found.read("gaussians/rest") == 0)
    both = Gaussians.concatenate([wall(), read_gaussians(found, "gaussians/").select(own)])
    shown, _, _ = render(both, CAMERA, np.eye(4), SETTINGS, sh_degree=1, background=None)
    picture = verify(made / "frames.zarr", SCHEMAS).row("rgb", 15) / 255
    error = np.abs(shown.numpy() - picture)
    assert error[45:51, LEFT - 3 : LEFT + 3].mean() < 0.08 and error[:, 48:].mean() < 0.01


def test_views_in_parts_teach_the_same_and_few_nearly(made, found, tmp_path, monkeypatch):
    monkeypatch.setattr("egosplat.histories.places._VIEWS_AT_ONCE", 1)
    assert learn(made, tmp_path / "histories.zarr").digest == found.digest
    monkeypatch.setattr("egosplat.histories.places._MOST", 12)
    np.testing.assert_allclose(learn(made, tmp_path / "few").read("rests/until_frame"), [24, 59], atol=4)


@pytest.mark.parametrize("cosine", [0.96, 0.5])
def test_carries_that_look_alike_have_one_feature(cosine):
    rows = np.array([(1, 0), (cosine, (1 - cosine**2) ** 0.5), (0, 1)], np.float32)
    columns = {"instance": np.array([3, 3, 4]), "frame": np.array([15, 60, 15]), "feature": rows}
    seen = (SimpleNamespace(frame=np.arange(first, first + 30)) for first in (0, 45))
    carries = [SimpleNamespace(track=3, others=(), seen=one) for one in seen]
    views = SimpleNamespace(read=columns.get, chunks=lambda _: [(0, rows)], shape=lambda _: rows.shape)
    found = _features_of_carries(carries, views)
    total = rows[:2].sum(axis=0)
    expected = [total / np.linalg.norm(total)] * 2 if cosine > 0.9 else rows[:2]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_without_tracks_nothing_is_carried(made, tmp_path):
    for name in ("frames", "poses", "splats"):
        (tmp_path / f"{name}.zarr").symlink_to(made / f"{name}.zarr")
    for name, given in (("instances", ["frames"]), ("view_features", ["frames", "instances"])):
        artifact = open_artifact(made / f"{name}.zarr", SCHEMAS[name])
        arrays = {key: artifact.read(key) for key in artifact.schema.fields if artifact.has(key)}
        arrays |= {"instances/moving": np.array([False])} if name == "instances" else {}
        put(tmp_path, name, arrays, artifact.facts, made_from=given)
    found = learn(tmp_path, tmp_path / "histories.zarr")
    assert all(found.shape(name) == (0, 3) for name in ("carries/start", "rests/center", "gaussians/means"))
    assert found.shape("things/feature") == (0, 128)


def test_inputs_that_do_not_belong_together_are_an_error(made, tmp_path):
    for name in INPUTS[:-1]:
        (tmp_path / f"{name}.zarr").symlink_to(made / f"{name}.zarr")
    put(tmp_path, "splats", {"means": np.zeros((1, 3), np.float32)}, inputs={"frames.zarr": "0" * 64})
    with pytest.raises(UserError, match=r"splats\.zarr"):
        learn(tmp_path, tmp_path / "histories.zarr")
