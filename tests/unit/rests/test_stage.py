"""Stage rests on a small scene: a blue square that lies left on a wall, is carried, and lies right."""

from dataclasses import asdict

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.errors import UserError
from egosplat.gaussians.io import STORED
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import render
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.text import encode_phrases
from egosplat.rests.options import RestsOptions
from egosplat.rests.stage import run
from tests.support.page_scene import CAMERA, SETTINGS, wall
from tests.support.scenes import UP, camera_facts, put

# A tenth of a second each: at rest on the left, on the way, at rest on the right.
COUNT, LEFT, RIGHT, HALF = 60, 24, 72, 5
COLUMNS = np.concatenate([np.full(25, LEFT), np.linspace(LEFT, RIGHT, 12)[1:-1], np.full(25, RIGHT)]).round()
BLUE = (30, 60, 220)
SMALL = {"clip_model": "small", "clip_checkpoint": "small"}
INPUTS = ("frames", "poses", "instances", "view_features", "splats", "carries")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with what the stage reads; of the carry, each end is known."""
    folder, side, gaussians = tmp_path_factory.mktemp("rests"), CAMERA.width, wall()
    empty, _, _ = render(gaussians, CAMERA, np.eye(4), SETTINGS, sh_degree=1, background=None)
    rgb = np.tile((empty.clamp(0, 1) * 255).round().to(torch.uint8).numpy(), (COUNT, 1, 1, 1))
    labels = np.full((COUNT, 1, side, side), -1, np.int32)
    for frame, column in enumerate(COLUMNS.astype(int)):
        part = np.s_[frame, 48 - HALF : 48 + HALF, column - HALF : column + HALF]
        rgb[part] = BLUE
        labels[:, 0][part] = 0
    times = np.arange(COUNT, dtype=np.int64) * 10**8
    facts = camera_facts(CAMERA)
    put(folder, "frames", {"rgb": rgb, "train": np.arange(COUNT) % 10 != 5, "timestamp_ns": times}, facts)
    arrays = {
        "camera_to_world": np.tile(np.eye(4), (COUNT, 1, 1)),
        "registered": np.ones(COUNT, bool),
        "up": UP,
    }
    put(folder, "poses", arrays | {"intrinsics": CAMERA.matrix}, facts, made_from=["frames"])
    arrays = {"labels": labels, "instances/level": np.zeros(1, np.int8), "instances/moving": np.array([True])}
    about = {"levels": ["whole"], "source": "masks", "instances": {"whole": 1}}
    put(folder, "instances", arrays, about, made_from=["frames"])
    clip = {"model": "small", "checkpoint": "small", "hash": model_hash(CLIP, SMALL)}
    cup = encode_phrases(load_open_clip("small", "small", "cpu", "float32"), ["cup"]).numpy()
    arrays = {"instance": np.zeros(1, np.int32), "frame": np.zeros(1, np.int32), "feature": cup}
    arrays["instances/level"] = np.zeros(1, np.int8)
    put(
        folder,
        "view_features",
        arrays,
        {"levels": ["whole"], "clip": clip},
        made_from=["frames", "instances"],
    )
    stored = {name: getattr(gaussians, name).numpy() for name in STORED if name != "features"}
    about = {"camera": asdict(CAMERA), "sh_degree_in_use": 1, "views": {"training": COUNT}}
    put(folder, "splats", stored, about, options=asdict(SETTINGS), made_from=["frames", "poses"])
    arrays = {
        "instance": np.zeros(1, np.int32),
        "first_frame": np.array([25]),
        "last_frame": np.array([34]),
        "start": np.array([[-0.8, 0.0, 2.0]]),
        "end": np.array([[0.8, 0.0, 2.0]]),
        "size": np.array([1 / 3]),
        "best_frame": np.array([0]),
        "feature": cup,
    }
    put(folder, "carries", arrays, {"tracks": 1}, made_from=[*INPUTS[:-1]])
    return folder


def learn(folder, output):
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in INPUTS}
    run(**paths, output=output, options=RestsOptions())
    return verify(output, SCHEMAS)


@pytest.fixture(scope="module")
def rests(made):
    return learn(made, made / "rests.zarr")


def test_a_thing_rests_before_and_after_its_carry(rests):
    """The spans are those of the pictures, not those of the track."""
    assert rests.shape("center") == (2, 3)
    np.testing.assert_allclose(rests.read("center")[:, 0], [-0.8, 0.8], atol=0.1)
    first, last = rests.read("from_frame"), rests.read("until_frame")
    np.testing.assert_allclose([*first, *last], [0, 35, 24, 59], atol=2)
    assert (rests.read("gain") > 0.3).all()


def test_rests_of_one_carry_are_one_thing_with_one_feature(rests):
    assert rests.read("thing").tolist() == [0, 0] and rests.read("carries/thing").tolist() == [0]
    assert [rests.read(f"carries/{name}_rest").tolist() for name in ("from", "to")] == [[0], [1]]
    np.testing.assert_allclose(np.linalg.norm(rests.read("things/feature"), axis=1), 1.0, rtol=1e-5)


def test_the_scene_at_a_time_shows_the_thing_where_it_lies(made, rests):
    """A frame outside the training, in which the scene alone shows the bare wall."""
    frame = 15
    own = torch.from_numpy(rests.read("gaussians/rest") == 0)
    stored = {
        name: torch.from_numpy(rests.read(f"gaussians/{name}")) for name in STORED if name != "features"
    }
    resting = Gaussians(**stored, features=torch.zeros(len(own), 0)).select(own)
    both = Gaussians.concatenate([wall(), resting])
    shown, _, _ = render(both, CAMERA, np.eye(4), SETTINGS, sh_degree=1, background=None)
    picture = verify(made / "frames.zarr", SCHEMAS).row("rgb", frame) / 255
    there = np.s_[48 - 3 : 48 + 3, LEFT - 3 : LEFT + 3]
    assert np.abs(shown.numpy()[there] - picture[there]).mean() < 0.08
    elsewhere = np.s_[:, 48:]
    assert np.abs(shown.numpy()[elsewhere] - picture[elsewhere]).mean() < 0.01


def test_the_same_seed_learns_the_same(made, rests, tmp_path):
    again = learn(made, tmp_path / "rests.zarr")
    for name in rests.schema.fields:
        np.testing.assert_array_equal(rests.read(name), again.read(name))


def test_no_carry_gives_no_rest(made, tmp_path):
    for name in INPUTS[:-1]:
        (tmp_path / f"{name}.zarr").symlink_to(made / f"{name}.zarr")
    put(
        tmp_path, "carries", {"feature": np.zeros((0, 128), np.float32)}, {"tracks": 0}, made_from=INPUTS[:-1]
    )
    found = learn(tmp_path, tmp_path / "rests.zarr")
    assert found.shape("center") == (0, 3) and found.shape("gaussians/means") == (0, 3)
    assert found.shape("things/feature") == (0, 128)


def test_carries_of_other_gaussians_are_an_error(made, tmp_path):
    for name in INPUTS[:-1]:
        (tmp_path / f"{name}.zarr").symlink_to(made / f"{name}.zarr")
    put(tmp_path, "carries", {}, {"tracks": 0}, inputs={"splats.zarr": "0" * 64})
    with pytest.raises(UserError, match=r"carries\.zarr"):
        learn(tmp_path, tmp_path / "rests.zarr")
