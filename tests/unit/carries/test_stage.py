"""Stage carries on a small scene: a square that is carried across a wall."""

from dataclasses import asdict

import numpy as np
import pytest

from egosplat.artifacts.reader import verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.carries.options import CarriesOptions
from egosplat.carries.stage import run
from egosplat.errors import UserError
from tests.support.page_scene import CAMERA, SETTINGS, wall
from tests.support.scenes import UP, camera_facts, put

# Ten frames of rest, ten on the way, ten of rest, a tenth of a second each. The square is a third of a meter on a wall 2 m ahead.
COUNT, HALF = 30, 5
LEFT, RIGHT = 24, 72


def columns():
    """Column of the middle of the square in each frame."""
    return np.concatenate([np.full(10, LEFT), np.linspace(LEFT, RIGHT, 12)[1:-1], np.full(10, RIGHT)]).round()


def there_and_back():
    """The same, with the way back after 15 frames of rest."""
    return np.concatenate([columns(), np.full(5, RIGHT), columns()[::-1]])


@pytest.fixture
def scene(tmp_path):
    """``scene(moving=, posed=, middle=, shown=, features=)``: a folder with all that the stage reads."""

    def make(moving=True, posed=True, middle=None, shown=(0, 15, 29), features=((1, 0), (0.8, 0.6), (1, 0))):
        side, middle = CAMERA.width, columns() if middle is None else middle
        count = len(middle)
        labels = np.full((count, 1, side, side), -1, np.int32)
        for frame, column in enumerate(middle.astype(int)):
            labels[frame, 0, 48 - HALF : 48 + HALF, column - HALF : column + HALF] = 0
        facts = camera_facts(CAMERA)
        put(tmp_path, "frames", {"rgb": np.zeros((count, side, side, 3), np.uint8)}, facts)
        poses = np.tile(np.eye(4) if posed else np.full((4, 4), np.nan), (count, 1, 1))
        registered = np.full(count, posed)
        arrays = {"camera_to_world": poses, "registered": registered, "up": UP, "intrinsics": CAMERA.matrix}
        put(tmp_path, "poses", arrays, facts, made_from=["frames"])
        about = {"levels": ["whole"], "source": "masks", "instances": {"whole": 1}}
        arrays = {
            "labels": labels,
            "instances/level": np.zeros(1, np.int8),
            "instances/moving": np.array([moving]),
        }
        put(tmp_path, "instances", arrays, about, made_from=["frames"])
        arrays = {"instance": np.zeros(len(shown), np.int32), "frame": np.int32(shown)}
        arrays["feature"] = np.array(features, np.float32)
        arrays |= {"instances/level": np.zeros(1, np.int8)}
        put(tmp_path, "view_features", arrays, {"levels": ["whole"]}, made_from=["frames", "instances"])
        gaussians = wall()
        names = ("means", "quats", "log_scales", "logit_opacities", "sh")
        stored = {name: getattr(gaussians, name).numpy() for name in names}
        about = {"camera": asdict(CAMERA), "sh_degree_in_use": 1, "views": {"training": count}}
        put(tmp_path, "splats", stored, about, options=asdict(SETTINGS), made_from=["frames", "poses"])
        return tmp_path

    return make


def carried(folder):
    names = ("frames", "poses", "instances", "view_features", "splats")
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in names}
    run(**paths, output=folder / "carries.zarr", options=CarriesOptions())
    return verify(folder / "carries.zarr", SCHEMAS)


def test_a_square_is_carried_from_left_to_right(scene):
    found = carried(scene())
    assert found.shape("start") == (1, 3)
    # 24 px left and right of the middle, at 2 m and 60 px of focal length.
    np.testing.assert_allclose(found.read("start")[0], [-0.8, 0, 2], atol=0.06)
    np.testing.assert_allclose(found.read("end")[0], [0.8, 0, 2], atol=0.06)
    assert abs(found.read("first_frame")[0] - 10) <= 4 and abs(found.read("last_frame")[0] - 19) <= 4
    assert found.read("size")[0] == pytest.approx(1 / 3, rel=0.05)
    np.testing.assert_allclose(found.read("feature")[0], np.array([2.8, 0.6]) / np.hypot(2.8, 0.6), rtol=1e-5)
    frame, box = found.read("best_frame")[0], found.read("box")[0]
    assert box.tolist() == [columns()[frame] - HALF, 48 - HALF, columns()[frame] + HALF, 48 + HALF]


@pytest.mark.parametrize("cosine", [0.96, 0.5])
def test_carries_that_look_alike_have_one_feature(scene, cosine):
    """A thing is seen in parts; its carries together name it better than one alone. Another thing is left out."""
    views = np.array([(1, 0), (cosine, (1 - cosine**2) ** 0.5)])
    found = carried(scene(middle=there_and_back(), shown=(15, 60), features=views)).read("feature")
    total = views.sum(axis=0)
    expected = [total / np.linalg.norm(total)] * 2 if cosine > 0.9 else views
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize("how", [{"moving": False}, {"posed": False}])
def test_without_tracks_and_without_poses_nothing_is_carried(scene, how):
    """What stands still was merged in 3D; a frame without a pose has no places."""
    found = carried(scene(**how))
    assert found.shape("start") == (0, 3) and found.shape("feature") == (0, 2)


def test_inputs_that_do_not_belong_together_are_an_error(scene):
    folder = scene()
    put(
        folder / "other",
        "splats",
        {"means": np.zeros((1, 3), np.float32)},
        {},
        inputs={"frames.zarr": "0" * 64},
    )
    (folder / "splats.zarr").rename(folder / "mine.zarr")
    (folder / "other" / "splats.zarr").rename(folder / "splats.zarr")
    with pytest.raises(UserError, match=r"splats\.zarr"):
        carried(folder)
