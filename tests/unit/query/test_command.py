"""``egosplat query``: an answer in words and a picture."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FEATURES, length_unit
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.suitability import notice
from egosplat.query import command, finished_scene, things
from egosplat.query import grades as calibration
from egosplat.query.answers import Answer, ViewMatch
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import by_score, held_keys
from egosplat.query.options import QueryOptions
from egosplat.query.reading import Question
from egosplat.viewing.command import page_options
from egosplat.viewing.options import PageOptions


@pytest.fixture
def query(run_command):
    return partial(run_command, "query")


@pytest.fixture
def fitted(monkeypatch):
    """``fitted(found=..., guess=...)``: the bundled OpenCLIP has a fit of the lead, and grades these limits."""

    def fit(found: float, guess: float = 0.3) -> None:
        row = held_keys(QueryOptions()) | dict.fromkeys(("intercept", "level", "fit", "apart"), "0")
        row |= {"lead": "2", "present_share": "0.7", "misplaced": "0"}
        monkeypatch.setattr(calibration, "LEAST_FOUND", found)
        monkeypatch.setattr(calibration, "LEAST_GUESS", guess)
        digest = model_hash(CLIP, {"clip_model": "small", "clip_checkpoint": "small"})
        monkeypatch.setattr(calibration, "read_fits", lambda: {digest: row})

    return fit


def columns(line: str) -> list[str]:
    return [part.strip() for part in line.split("  ") if part.strip()]


def test_a_frame_is_answered_in_words_and_in_a_picture(word_scene, query):
    folder = word_scene(origin="real")
    status, out, err = query(folder, "couch", "cup", "--frame", 1)
    assert status == 0, err
    title, told, header, couch, cup, picture = out.splitlines()
    assert title == f"{folder}, frame 1, origin real" and told == notice("real", {"clip_checkpoint": "small"})
    assert columns(header) == ["query", "answer", "score", "level", "pixel", "position [m]"]
    assert header.index("level") == couch.index("whole") == cup.index("whole")
    words, grade, score, level, pixel, position = columns(couch)
    assert (words, grade, level) == ("couch", "found", "whole") and float(score) > 0.5
    assert int(pixel.split(",")[0]) < 24 <= int(columns(cup)[4].split(",")[0])
    assert [float(one) for one in position.split(",")][2] == pytest.approx(2.0, abs=0.02)
    assert picture == f"picture: {folder / 'query.png'}"
    width, height = Image.open(folder / "query.png").size
    assert width > height > 400


def test_the_whole_scene_is_answered_in_3d(word_scene, query, fitted):
    folder = word_scene()
    fitted(found=0.6)
    status, out, err = query(folder, "couch", "cup")
    assert status == 0, err
    title, told, header, couch, cup, picture = out.splitlines()
    assert "70%" in told and "query.present_share" in told
    assert title == f"{folder}, the whole scene, origin synthetic"
    assert columns(header) == ["query", "answer", "probability", "level", "center [m]", "size [m]", "frame"]
    for line, words, side in ((couch, "couch", -1), (cup, "cup", 1)):
        found, grade, probability, level, center, size, frame = columns(line)
        assert (found, grade, level, frame) == (words, "found", "whole", "0") and float(probability) >= 0.6
        x, y, z = (float(one) for one in center.split(","))
        # Each word is half of a wall 2 m ahead, 1.6 m wide; the camera sees 2.2 m of the 3.2 m.
        assert np.abs([side * x - 0.5, y]).max() < 0.25 and z == pytest.approx(2.0)
        width, height, depth = (float(one) for one in size.split(" x "))
        assert 0.7 < width < 1.6 and 1.8 < height < 3.2 and depth == 0.0
    assert picture == f"picture: {folder / 'query.png'}"


def test_a_question_has_a_sentence_and_what_cannot_be_asked_stops_no_other(word_scene, query, fitted):
    fitted(found=0.6)
    asked = "where are my cups?", " ", "couch", "couch next to the cup", "cuop", "cup " * 60
    status, out, err = query(folder := word_scene(), *asked)
    assert status == 2 and "2 of 6 questions" in err and (folder / "query.png").exists()
    rows = [columns(line) for line in out.splitlines()[3:9]]
    assert [row[0] for row in rows[:-1]] == ["cup", "''", "couch", "couch next to cup", "cuop"]
    assert "blank" in rows[1][1] and 'Did you mean "cup"?' in rows[4][1] and "60 tokens" in rows[5][1]
    cup, couch = [line for line in out.splitlines() if "(read as: " in line]
    assert cup.startswith('"where are my cups?" (read as: cup): found: a cup at ') and "query.png" in cup
    assert couch.startswith('"couch next to the cup" (read as: couch next to cup): ')
    assert "1 of 1 questions" in query(folder, "what is on the cup", "--frame", 1, "--overwrite")[2]


def test_json_tells_what_print_shows_of_each_answer_and_nothing_else_is_printed(word_scene, query):
    ((folder := word_scene()) / "query.png").mkdir()  # no picture can be written there
    status, out, err = query(folder, "where is my cup?", "zeppelin", " ", "--json", "--quiet")
    assert (status, err) == (0, "")
    cup, zeppelin, blank = json.loads(out)
    [answer] = open_scene(folder, device="cpu").ask(cup["typed"])
    assert (cup["asked"], cup["grade"], cup["things"][0]["second"]) == ("cup", "found", 0.0)
    assert cup["things"][0]["center"] == answer.things[0].center.tolist() and len(repr(answer)) < 20 * 80
    assert zeppelin["untaught"] == ["zeppelin"] and blank["grade"] == "not asked"


def test_what_is_not_there_is_rejected_and_so_is_what_words_of_homes_win(word_scene, query, monkeypatch):
    words = "basketball", "spaceship", "couch", "--set", "min_score=0.65"
    status, out, err = query(folder := word_scene(), *words)
    notice, _, basketball, spaceship, couch = out.splitlines()[1:6]
    assert status == 0 and "not calibrated" in notice and "0.65" in notice, err
    assert "not found: the best match is below 0.65 (score 0." in basketball
    assert columns(spaceship) == ["spaceship", 'The models here were never taught the word "spaceship".']
    assert columns(couch)[1] == "found" and columns(couch)[3] == "whole"
    monkeypatch.setattr(calibration, "read_fits", lambda *_: {})
    scene = open_scene(folder, device="cpu", min_score=0.0)
    asked = [scene.ask("couch", "cup", "toaster", **where) for where in ({}, {"frame": 2})]
    assert [[one.grade for one in each] for each in asked] == [["found", "found", "not found"]] * 2
    assert scene.ask("cup", min_score=0.999)[0].grade == "not found", "a limit of the user's holds, too"
    assert "egosplat calibrate" in query(folder, "cup", "--set", "min_score=0", "--overwrite")[1]


def test_a_best_guess_has_its_place_and_not_found_has_none(word_scene, query, fitted):
    folder = word_scene()
    some = (0.6, 0.3, "found", "not found"), (1.01, 0.3, "best guess", "not found")
    more = (1.01, 0.0, "best guess", "best guess"), (1.01, 1.01, "not found", "not found")
    for found, guess, *grades in (*some, *more):
        fitted(found, guess)
        status, out, err = query(folder, "cup", "basketball", "--overwrite")
        assert status == 0, err
        for line, grade in zip(map(columns, out.splitlines()[3:5]), grades, strict=True):
            assert line[1].startswith(grade) and (len(line) == 7) is (grade != "not found")
        answers = open_scene(folder, device="cpu").ask("cup", "basketball")
        assert [one.grade for one in answers] == grades
        assert all(bool(one.things) is (one.refusal is None) is (one.grade != "not found") for one in answers)
        assert all(0 < one.probability < 1 and one.candidates for one in answers)
        assert answers[0].probability > answers[1].probability


def test_things_of_a_lower_grade_are_not_listed_with_those_that_are_found(word_scene, fitted):
    """The best thing by score decides the grade, however many are listed; the others of the answer share it."""
    fitted(found=0.6, guess=0.0)
    [cup] = open_scene(word_scene(), device="cpu").ask("cup", most=8)
    ratings = [one.rating for one in cup.candidates]
    assert cup.probability == ratings[0] and cup.score == max(one.score for one in cup.candidates)
    assert [one.rating for one in cup.things] == [one for one in ratings if one >= 0.6]


def test_a_scene_without_codes_or_things_has_no_answer_at_any_limit(word_scene, query, monkeypatch):
    folder, read = word_scene(), finished_scene.read_scene
    with monkeypatch.context() as patch:
        patch.setattr(things, "LEAST_GAUSSIANS", 10_000)
        _, out, _ = query(folder, "cup")
    assert columns(out.splitlines()[-2]) == ["cup", "not found: nothing here looks like it"]

    def without_codes(*given):
        scene = read(*given)
        return replace(scene, share=torch.zeros_like(scene.share))

    monkeypatch.setattr(finished_scene, "read_scene", without_codes)
    _, out, err = query(folder, "cup", "--set", "min_score=0", "--overwrite")
    assert columns(out.splitlines()[3]) == ["cup", "no Gaussian of the scene has a code"], err


def test_the_answer_in_words_comes_before_the_picture(word_scene):
    picture = word_scene() / "query.png"
    answers = command.run(open_scene(picture.parent, device="cpu"), ["cup"], None, 1, picture)
    assert "cup" in next(answers) and not picture.exists()
    assert next(answers).startswith("picture: ") and picture.exists()


@pytest.mark.parametrize(
    "model, temperature, min_score", [("small", 10.0, 0.7), ("photos", 10.0, 0.62), ("ViT-B-16", 1.0, 0.0)]
)
def test_queries_and_pages_follow_the_model_of_the_features(word_scene, model, temperature, min_score):
    folder = word_scene(clip_model=model)
    features = open_artifact(folder / "features.zarr", FEATURES)
    of_page = page_options(features, PageOptions(device="cpu"))
    for asked in (open_scene(folder).options, of_page):
        assert (asked.temperature, asked.min_score) == (temperature, min_score)
    assert of_page.clip_model == model
    assert open_scene(folder, min_score=0.5).options.min_score == 0.5
    assert page_options(features, PageOptions(min_score=0.5)).min_score == 0.5


def test_lengths_have_no_meters_without_a_scale(word_scene, query, monkeypatch):
    folder, arbitrary = word_scene(), SimpleNamespace(facts={"notes": {"scale": "arbitrary"}})
    monkeypatch.setattr(finished_scene, "length_unit", lambda _: length_unit(arbitrary))
    for words, column in (((), "center [scene units]"), (("--frame", 1), "position [scene units]")):
        assert column in query(folder, "cup", *words)[1]
    monkeypatch.setattr(finished_scene.Scene, "ruler", (0.4, 0.1))
    told = "a scene unit is about 0.4 m (0.36 to 0.44), by the sizes of things"
    assert told in query(folder, "cup", "--overwrite")[1]


def test_many_answers_are_drawn_in_part(word_scene, query):
    words = ("couch", "bed", "box", "door", "vase", "plate", "pot", "toy", "wall", "rug")
    many = [f"cup {word}" for word in words]
    _, out, _ = query(word_scene(), *many)
    assert "the first 8 answers; 2 more are in the table only" in out.splitlines()[-1]
    assert all(f"\n{phrase}" in out for phrase in many)


def test_a_pose_that_sees_nothing_gives_no_answer(word_scene, query, tmp_path):
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    (tmp_path / "away.json").write_text(json.dumps({"camera_to_world": away.tolist()}))
    output, words = tmp_path / "made" / "away.png", ("--pose", tmp_path / "away.json", "--set", "min_score=0")
    status, out, err = query(word_scene(), "cup", *words, "--output", output)
    assert status == 0, err
    assert columns(out.splitlines()[2]) == ["cup", "nothing is visible here"]
    assert Image.open(output).size[0] > 400


@pytest.mark.parametrize(
    "words, said",
    [
        (["lacking"], "lacks language.zarr. Give the folder of a finished scene"),
        (["cup", "--frame", "4"], "frame 4: there are 4 frames, 0 to 3"),
        (["cup", "--set", "canonical=[]"], "query.canonical"),
        (["cup", "--set", "min_score=2"], "query.min_score"),
        (["cup", "--set", "present_share=0"], "query.present_share"),
        (["another"], "was made with another OpenCLIP"),
        ([], "PHRASES"),
    ],
)
def test_unanswerable_queries_are_reported(word_scene, query, words, said):
    folder = word_scene(clip_hash="0123456789abcdef" if words == ["another"] else None)
    if words == ["lacking"]:
        shutil.rmtree(folder / "language.zarr")
    status, out, err = query(folder, *words)
    assert status == 2 and out == "" and said in err and "Traceback" not in err
    assert ("0123456789abcdef" in err) == (words == ["another"]) and not (folder / "query.png").exists()
    assert f"Did you mean {folder}? Give" in query(folder.with_name(f"{folder.name}s"), "cup")[2]


def test_a_long_refusal_does_not_widen_a_column(tmp_path):
    """The three pictures of a row are equally wide, whatever is written below, and nothing of that is cut off."""
    gray, nothing = np.full((40, 40, 3), 0.5, np.float32), np.zeros((40, 40), np.float32)
    view = ViewMatch("cup", 0.9, "whole", (20, 20), None, nothing, "whole", nothing == 0)
    cup = Answer("cup", "found", 0.9, view=view), "", gray
    refused = Answer("zeppelin", "not found", 0.2, refusal="not found: " + "a long reason " * 12), "", None
    command.draw_answers([cup, refused], "a scene", tmp_path / "page.png")
    page = np.asarray(Image.open(tmp_path / "page.png").convert("L")).astype(int)
    # The row of pixels with the most ink crosses the pictures.
    inked = (page < 250)[(page < 250).sum(axis=1).argmax()]
    edges = np.flatnonzero(np.diff(np.r_[0, inked.astype(int), 0]))
    widths = np.sort(edges[1::2] - edges[::2])[-3:]
    assert widths.min() > 0.95 * widths.max() > 0.2 * page.shape[1] and page[:, -1].min() > 250


def test_what_is_carried_and_does_not_stand_so_is_told_so():
    question, why = Question("cushion", "on", (Question("couch"),)), "a cushion, but none is seen on a couch"
    answer = Answer("cushion", "not found", 0.0, refusal=why, history=("carried",), question=question)
    for one, told in ((answer, why), (replace(answer, question=None), "it was carried")):
        assert command.answer_rows(one, by_score(0.95))[0][1].startswith(told)
    plain = replace(answer, question=Question("cushion", typed="where is my cushion?"))
    assert "it was carried" in command._sentence(plain, "m", Path("query.png"))[0]
