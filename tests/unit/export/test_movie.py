"""``egosplat movie``: a moving picture of the answers."""

import numpy as np
import pytest
from PIL import Image

from egosplat.export.movie import way
from tests.support.commands import run_command


@pytest.fixture
def movie(page_scene, tmp_path, monkeypatch, capfd):
    """``movie(*words)``: exit status, and what it said; the picture is ``x.webp``."""

    def call(*words: object) -> tuple[int, str]:
        given = (page_scene, *words, "--output", tmp_path / "x.webp", "--side", 64)
        return run_command(monkeypatch, capfd, "movie", *given)[::2]

    return call


def test_the_picture_moves_and_the_answer_lights_up(movie, tmp_path):
    status, said = movie("wall", "couch", "elephant")
    assert status == 0, said
    assert "elephant" in said and "left out" in said
    with Image.open(tmp_path / "x.webp") as moving:
        assert moving.size[0] == 64 < moving.size[1] and moving.n_frames > 8
        moving.seek(moving.n_frames - 1)
        last = np.asarray(moving.convert("RGB"))[:64].astype(int)
    redness = last[..., 0] - last[..., 2]
    assert redness[:, 16:36].mean() > redness[:, 44:].mean() + 20, "the couch is left of the wall"


def test_without_an_answer_nothing_is_written(movie, tmp_path):
    status, said = movie("elephant")
    assert status == 2 and "no query has an answer" in said and not (tmp_path / "x.webp").exists()


def test_the_way_follows_the_recording_and_leaves_out_frames_without_a_pose():
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[3] = np.nan
    assert way(poses, 1, 5) == [2, 4, 5] and way(poses, 5, 1) == [4, 2, 1] and way(poses, 2, 2) == []
    long = way(np.tile(np.eye(4), (100, 1, 1)), 0, 99)
    assert len(long) == 16 and long[-1] == 99
