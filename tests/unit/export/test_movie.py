"""``egosplat movie``: a moving picture of the answers."""

import numpy as np
import pytest
from PIL import Image

from egosplat.export.movie import way
from egosplat.query.finished_scene import open_scene
from tests.support.commands import run_command
from tests.support.page_scene import put_histories, put_page_scene


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "scene1"
    folder.mkdir()
    put_page_scene(folder)
    put_histories(folder)
    return folder


@pytest.fixture
def movie(monkeypatch, capfd):
    """``movie(*words)``: exit status, and what it said."""

    def call(*words: object) -> tuple[int, str]:
        return run_command(monkeypatch, capfd, "movie", *words)[::2]

    return call


def test_the_picture_moves_and_the_answer_lights_up(scene, movie, tmp_path):
    output = tmp_path / "x.webp"
    status, said = movie(scene, "wall", "couch", "elephant", "--output", output, "--side", 64)
    assert status == 0, said
    assert "elephant" in said and "left out" in said
    with Image.open(output) as moving:
        assert moving.size[0] == 64 < moving.size[1] and moving.n_frames > 8
        moving.seek(moving.n_frames - 1)
        last = np.asarray(moving.convert("RGB"))[:64].astype(int)
    redness = last[..., 0] - last[..., 2]
    assert redness[:, 16:36].mean() > redness[:, 44:].mean() + 20, "the couch is left of the wall"


def test_a_ring_is_where_the_carried_thing_lies(scene, movie, tmp_path):
    """The cup is carried from 0.1 s to 0.2 s: frame 0 shows it on the left, frame 4 on the right, and no frame between has a ring."""
    output = tmp_path / "x.webp"
    status, said = movie(scene, "cup", "--output", output, "--side", 96)
    assert status == 0, said
    photographs, white = open_scene(scene).frames, {}
    with Image.open(output) as moving:
        assert moving.n_frames == 4, "frame 3 has no pose"
        for place, frame in enumerate((0, 1, 2, 4)):
            moving.seek(place)
            shown = np.asarray(moving.convert("RGB"))[:96, :96].astype(int)
            added = (shown.min(axis=2) > 225) & (photographs[frame].max(axis=2) < 215)
            white[frame] = np.flatnonzero(added.any(axis=0))
    assert len(white[1]) == len(white[2]) == 0
    # The camera is at -0.8 m and at 0.8 m, the places at -1 m and 1 m, 2 m ahead: 6 px from the middle.
    assert abs(white[0].mean() - 42) < 2 and abs(white[4].mean() - 54) < 2


def test_without_an_answer_nothing_is_written(scene, movie, tmp_path):
    status, said = movie(scene, "elephant", "--output", tmp_path / "x.webp")
    assert status == 2 and "no query has an answer" in said and not (tmp_path / "x.webp").exists()


def test_the_way_follows_the_recording_and_leaves_out_frames_without_a_pose():
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[3] = np.nan
    assert way(poses, 1, 5) == [2, 4, 5] and way(poses, 5, 1) == [4, 2, 1] and way(poses, 2, 2) == []
    long = way(np.tile(np.eye(4), (100, 1, 1)), 0, 99)
    assert len(long) == 16 and long[-1] == 99
