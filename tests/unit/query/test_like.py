"""Things that are found by pictures of them, and by names that were given by hand."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.query import like
from egosplat.query.finished_scene import open_scene
from egosplat.query.like import Looks, ask_pictures
from tests.support.page_scene import put_looks


@pytest.fixture
def scene(page_scene, tmp_path) -> Path:
    """A scene whose things were seen in frames 0 and 2, with their pictures."""
    folder = Path(shutil.copytree(page_scene, tmp_path / "results/adt/scene1"))
    for name, crop in zip(("couch", "wall", "cup"), put_looks(folder), strict=True):
        Image.fromarray(crop).save(tmp_path / f"{name}.png")
    Image.fromarray(np.full((40, 40, 3), 255, np.uint8)).save(tmp_path / "white.png")
    return folder


def test_a_picture_finds_its_thing_and_when_it_was_seen_last(scene, run_command, tmp_path):
    pictures = [word for name in ("cup", "white") for word in ("--like", tmp_path / f"{name}.png")]
    _, out, err = run_command("query", scene, *pictures)
    asked, answer, similarity, lead, center, *_, last = re.split(r"\s{2,}", out.splitlines()[2])
    assert asked.endswith("cup.png") and answer == "found" and float(similarity) > 0.9, err
    assert float(center.split(",")[0]) > 0.5 and last.strip() == "0:00" and lead.startswith("+0.")
    assert "white.png  not found: no thing here looks like it" in out
    assert Image.open(scene / "query.png").height == 512
    thing = ask_pictures(open_scene(scene), tmp_path / "cup.png")[0].things[0]
    assert thing.center[0] > 0.5 and thing.share == (thing.frame + 9) / 96**2


def test_of_what_overlaps_the_most_alike_is_told(scene):
    looks = Looks(open_scene(scene, device="cpu"))
    asked = looks.feature[4:5]
    assert [one.instance for one in looks.find(asked, 8)] in ([2, 0, 1], [2, 1, 0])
    # The wall becomes a thing of the next level, on the Gaussians of the cup.
    looks.instance[2:4] = 5
    assert sorted(one.instance for one in looks.find(asked, 8)) == [0, 2]
    assert [one.instance for one in looks.find(looks.feature[2:3], 1)] == [5]
    assert "similarity of 0.85)" in like.SIMILARITY.refusal(0.8599), "a best guess begins at 0.86"


def test_crops_of_frames_on_their_side_are_turned_and_only_what_is_told_is_measured(scene, monkeypatch):
    looks, measure, crops, measured = Looks(open_scene(scene, device="cpu")), Looks._thing, [], []
    monkeypatch.setattr(like, "lies_on_its_side", lambda _: True)
    monkeypatch.setattr(like, "_encode", lambda _, some: crops.extend(some) or looks.feature[: len(some)])
    monkeypatch.setattr(Looks, "_thing", lambda *given: measured.append(given) or measure(*given))
    assert looks.find(looks.feature[4:5], 1, pictured=True) and len(measured) == 1
    assert {crop.shape for crop in crops} == {(30, 96, 3)}, "30 px wide, 96 px high"


def test_a_name_is_kept_and_asked_like_a_word_in_other_scenes_too(scene, run_command, tmp_path):
    other = Path(shutil.copytree(scene, tmp_path / "results/adt/other"))
    assert ' m is "My Mug": egosplat query' in run_command("name", scene, "cup", " My  Mug")[1]
    assert run_command("name", scene, "-1.0,0,2", "sofa")[0] == 0
    assert list(json.loads((scene / "names.json").read_text())) == ["my mug", "sofa"]
    for words, folder in (((), scene), (("--names", scene), other)):
        out = run_command("query", folder, "Where is my mug?", "couch", *words, "--overwrite")[1]
        assert run_command("query", folder, "my mug", "couch", *words, "--json")[1].count(': "found"') == 2
        assert "my mug?  found   1.00" in out and "\ncouch" in out and (folder / "query_like.png").exists()
    assert f"alike in {other}" in run_command("query", other, scene, "--like", tmp_path / "wall.png")[1]


@pytest.mark.parametrize(
    "words, told",
    [
        (["query", "--like", "small.png"], "small.png: 8x90 px"),
        (["query", "--like", "text.png"], "text.png: not a readable image"),
        (["query", "--like", "text.png", "--names", "old.json"], "--names: goes with words"),
        (["query", "My  mug", "--names", "old.json", "--frame", "1"], "--at: go with words alone"),
        (["query", "my mug", "--names", "old.json"], "'my mug': was named with another OpenCLIP"),
        (["name", "cup", " "], "name: is blank"),
        (["name", "9,9,9", "mug"], "9,9,9: no thing is there"),
        (["query", "my mug", "--names", "text.png"], "text.png: is no file of names"),
        (["query", "my mug", "--names", "names.json"], "is no file of names ('features'); remove it"),
        (["name", "spaceship", "mug"], '"spaceship".\nGive a place'),
        (["name", "1.2.3,0,0", "mug"], "asks for 2 things\nGive a place"),
    ],
)
def test_a_user_s_mistake_is_told(scene, run_command, folder, words, told):
    Image.new("RGB", (8, 90)).save("small.png")
    Path("text.png").write_text("no picture")
    Path("names.json").write_text('{"my mug": {"clip": "old"}}')
    Path("old.json").write_text(json.dumps({"my mug": {"clip": "old", "features": []}}))
    status, _, err = run_command(words[0], scene, *words[1:])
    assert status == 2 and told in err and "Traceback" not in err
