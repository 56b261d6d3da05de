"""The picture of a scene is drawn from whatever its artifacts hold."""

import numpy as np
import pytest

from egosplat.drawing import ground_axes
from egosplat.geometry import Camera
from egosplat.report.sheets.sheet import palette, tint
from tests.support.scenes import camera_facts, put_scene

HEIGHT, WIDTH = 24, 24


def scene(folder, frames: int, evaluation: int, points: int, instances: int, registered: int):
    rng, poses = np.random.default_rng(0), np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 3] = np.arange(frames)
    poses[registered:] = np.nan
    arrays = {
        "rgb": rng.integers(0, 255, (frames, HEIGHT, WIDTH, 3), dtype=np.uint8),
        "train": np.arange(frames) >= evaluation,
        "frame": np.arange(evaluation),
        "annotated": np.arange(evaluation) % 2 == 0,
        "instance_map": rng.integers(-1, instances, (evaluation, HEIGHT, WIDTH), dtype=np.int32),
        "camera_to_world": poses,
        "registered": np.arange(frames) < registered,
        "up": np.array([0.0, 1.0, 0.0]),
        "points/xyz": rng.normal(size=(points, 3)),
    }
    facts = camera_facts(Camera(WIDTH, HEIGHT, 20.0, 20.0, WIDTH / 2, HEIGHT / 2))
    facts["instances"] = [{"category": f"thing {i}"} for i in range(instances)]
    return put_scene(folder, ("frames", "annotations", "poses"), arrays, facts)


def test_titles_over_portrait_pictures_do_not_overlap(monkeypatch, tmp_path, draw, drawn, unreadable):
    monkeypatch.setitem(globals(), "HEIGHT", 32)
    monkeypatch.setitem(globals(), "WIDTH", 18)
    draw("contact_sheet", scene(tmp_path, 20, 6, 50, 7, 20))
    assert unreadable(drawn[0]) == []


@pytest.mark.parametrize(
    "counts", [(20, 5, 500, 7, 20), (3, 1, 1, 1, 2), (2, 0, 0, 0, 1)], ids=["usual", "few", "almost nothing"]
)
def test_the_page_is_written_as_one_picture(tmp_path, draw, counts):
    picture = draw("contact_sheet", scene(tmp_path, *counts))
    assert picture.shape[1] > 1000 and picture.std() > 10


@pytest.mark.parametrize("up", [[0, 1, 0], [0, 0, 1], [1, 0, 0], [0.6, 0.8, 0], [3**-0.5] * 3])
def test_ground_axes_are_orthonormal_and_seen_from_above(up):
    right, ahead = ground_axes(np.asarray(up, float))
    frame = np.stack([right, ahead, up])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-8)
    assert np.linalg.det(frame) == pytest.approx(1.0)  # right x ahead = up: not mirrored


def test_a_tint_tells_instances_apart_and_leaves_the_rest():
    picture = np.full((2, 2, 3), 100, np.uint8)
    tinted = tint(picture, np.array([[-1, 0], [1, 0]], np.int32), palette(2))
    assert (tinted[0, 0] == 100).all()
    assert (tinted[0, 1] == tinted[1, 1]).all() and (tinted[0, 1] != tinted[1, 0]).any()
    assert (tint(picture, np.full((2, 2), -1), palette(0)) == 100).all()
