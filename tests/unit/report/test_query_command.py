"""``egosplat query``: an answer in words and a picture."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat import cli
from egosplat.models.suitability import notice


@pytest.fixture
def query(monkeypatch, capfd):
    """``query(*words)``: exit status, what it printed, and what it complained of."""

    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["egosplat", "query", *map(str, words)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        printed = capfd.readouterr()
        return status, printed.out, printed.err

    return call


def columns(line: str) -> list[str]:
    return [part.strip() for part in line.split("  ") if part.strip()]


def test_it_answers_in_words_and_in_a_picture(word_scene, query):
    folder = word_scene()
    status, out, err = query(folder, "couch", "cup", "--frame", 1)
    assert status == 0, err
    title, header, couch, cup, picture = out.splitlines()
    assert title == f"{folder}, frame 1, origin synthetic"
    assert columns(header) == ["query", "score", "level", "pixel", "position [m]"]
    assert header.index("level") == couch.index("whole") == cup.index("whole")
    words, score, level, pixel, position = columns(couch)
    assert (words, level) == ("couch", "whole") and float(score) > 0.5
    assert int(pixel.split(",")[0]) < 24 <= int(columns(cup)[3].split(",")[0])
    assert [float(one) for one in position.split(",")][2] == pytest.approx(2.0, abs=0.02)
    assert picture == f"picture: {folder / 'query.png'}"
    width, height = Image.open(folder / "query.png").size
    assert width > height > 400


def test_small_checkpoints_on_a_real_recording_are_told_with_the_answers(word_scene, query):
    folder = word_scene(origin="real")
    status, out, err = query(folder, "couch", "--frame", 1)
    assert status == 0, err
    told = notice("real", {"clip_checkpoint": "small"})
    assert out.splitlines()[1] == told


def test_from_a_place_where_nothing_is_there_is_no_answer(word_scene, query, tmp_path):
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    (tmp_path / "away.json").write_text(json.dumps({"camera_to_world": away.tolist()}))
    output = tmp_path / "made" / "away.png"
    status, out, err = query(word_scene(), "cup", "--pose", tmp_path / "away.json", "--output", output)
    assert status == 0, err
    assert columns(out.splitlines()[2]) == ["cup", "0.000", "-", "-", "-"]
    assert Image.open(output).size[0] > 400


def test_words_with_dollars_are_drawn_as_they_are(word_scene, query):
    status, said, _ = query(word_scene(), "$\\frac{1}{$ cup", "couch")
    assert status == 0 and "$\\frac{1}{$ cup" in said


def test_keys_of_the_section_are_flags(word_scene, query):
    scores = []
    for temperature in ("10", "1"):
        _, out, _ = query(word_scene(), "cup", "--temperature", temperature, "--canonical", "[thing]")
        scores.append(float(columns(out.splitlines()[2])[1]))
    assert scores[0] > scores[1] > 0.5


def remove(name: str):
    def change(folder: Path) -> None:
        shutil.rmtree(folder / f"{name}.zarr")

    return change


@pytest.mark.parametrize(
    "change, words, said",
    [
        (remove("language"), ["cup"], "lacks language.zarr. Give the folder of a finished scene"),
        (None, ["cup", "--frame", "9"], "--frame 9: there are 4 frames, 0 to 3"),
        (None, ["cup", "--frame", "3"], "--frame 3: has no pose"),
        (None, ["cup", "--frame", "1", "--pose", "x.json"], "--frame and --pose: give one of them"),
        (None, [" "], "query: is blank"),
        (None, ["cup", "--canonical", "[]"], "needs at least 1 text"),
        (None, ["cup", "--canonical", "{a: 1}"], "is no list of texts"),
        (None, ["cup", "--min-coverage", "1"], "0<x<1"),
        (None, [], "PHRASES"),
    ],
)
def test_what_cannot_be_answered_is_said(word_scene, query, change, words, said):
    folder = word_scene()
    if change:
        change(folder)
    status, out, err = query(folder, *words)
    assert status == 2 and out == "" and said in err and "Traceback" not in err
    assert not (folder / "query.png").exists()


def test_another_openclip_than_that_of_the_features_is_refused(word_scene, query):
    status, _, err = query(word_scene(clip_hash="0123456789abcdef"), "cup")
    assert status == 2 and "was made with another OpenCLIP" in err and "0123456789abcdef" in err


def test_starting_imports_nothing_heavy():
    code = (
        "import sys; from egosplat.cli import cli; cli.get_command(None, 'query');"
        "print([name for name in ('torch', 'numpy', 'matplotlib', 'cv2', 'zarr') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
