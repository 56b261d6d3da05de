"""The viewer's answers without a browser: those of ``egosplat query``, kept in a cache, or the reason why there are none."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.reader import open_artifact
from egosplat.errors import UserError
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.options import LANGSPLAT
from egosplat.query.scene import read_scene
from egosplat.query.scene_query import ask_scene, index_scene
from egosplat.query.text import encode_texts
from egosplat.viewer import prepared
from egosplat.viewer.questions import Questions, open_questions, ray_camera
from egosplat.viewer.scene import open_scene
from egosplat.viewer.wording import named_text, reply_text


def questions_of(folder: Path, cache: Path | None = None) -> Questions:
    viewed = open_scene(folder, "cpu")
    return open_questions(viewed, LANGSPLAT, device="cpu", precision="auto", cache=cache)


def test_answers_are_those_of_the_query_command(word_scene):
    """One definition: the same things, scores and members as ``ask_scene`` finds."""
    folder = word_scene()
    viewed, questions = open_scene(folder, "cpu"), questions_of(folder)
    language = open_artifact(folder / "language.zarr", LANGUAGE)
    scene = read_scene(viewed.splats, language, open_artifact(folder / "features.zarr", FEATURES), "cpu")
    index = index_scene(scene, viewed.camera_to_world, scene.camera, viewed.frames.read("valid"))
    clip = load_open_clip("small", "small", "cpu", "auto")
    texts = encode_texts(clip, ["couch", "cup", "table"], LANGSPLAT.canonical)
    for expected in ask_scene(index, texts, LANGSPLAT, 3):
        found = questions.ask(expected.phrase).answer
        assert [thing.score for thing in found.things] == pytest.approx(
            [one.score for one in expected.things]
        )
        for thing, one in zip(found.things, expected.things, strict=True):
            assert np.array_equal(thing.members, one.members) and thing.level == one.level


def test_the_second_opening_reads_the_cache(word_scene, tmp_path, monkeypatch):
    """What was prepared is read again and gives the same answers; a damaged cache is made anew."""
    folder, cache = word_scene(), tmp_path / "cache"
    first = questions_of(folder, cache).ask("cup")
    [place] = cache.iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(prepared, "_compute", lambda *_: pytest.fail("computed again"))
        second = questions_of(folder, cache).ask("cup")
    assert np.array_equal(first.fit, second.fit) and first.answer.score == second.answer.score
    (place / "features.npy").write_bytes(b"damaged")
    assert questions_of(folder, cache).ask("cup").answer.score == first.answer.score


def test_the_cache_keeps_few_scenes(word_scene, tmp_path):
    """A scene that was not opened for long makes room for the next one."""
    cache = tmp_path / "cache"
    for number in range(prepared.MOST_SCENES + 2):
        (cache / f"old {number}").mkdir(parents=True)
    questions_of(word_scene(), cache)
    assert len(list(cache.iterdir())) == prepared.MOST_SCENES


def test_a_cache_that_cannot_be_written_is_no_obstacle(word_scene, tmp_path, capfd):
    """The scene is asked all the same, and one line says why the next start is slow."""
    (tmp_path / "a file").write_text("")
    assert questions_of(word_scene(), tmp_path / "a file" / "cache").ask("cup").things
    assert "cannot be written" in capfd.readouterr().err


def test_a_ray_is_named(word_scene):
    """A ray to the left meets the couch, one to the right the cup, one backwards nothing; the wall is 2 m ahead."""
    questions, origin = questions_of(word_scene()), np.zeros(3)
    for side, word in ((-0.5, "couch"), (0.5, "cup")):
        named = questions.name(origin, np.array([side, 0.1, 2.0]))
        assert named.position == pytest.approx([side, 0.1, 2.0], abs=0.05)
        part, whole = named.words
        assert part == () and whole[0][0] == word and whole[0][1] > 0.5
    assert questions.name(origin, np.array([0.0, 0.0, -1.0])).position is None


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 1, 0), (-3, 0, 0), (1, 2, 3)])
def test_the_middle_pixel_of_a_click_is_on_the_ray(direction):
    """In any direction the camera is right-handed and its middle pixel looks along the ray."""
    origin, ray = np.array([1.0, 2.0, 3.0]), np.array(direction, np.float64)
    camera, pose = ray_camera(origin, ray)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[:3, 2] == pytest.approx(ray / np.linalg.norm(ray))
    assert np.array_equal(pose[:3, 3], origin)
    assert camera.project(np.array([0.0, 0.0, 1.0])) == pytest.approx([camera.width / 2, camera.height / 2])


@pytest.mark.parametrize("lost", ["language", "features"])
def test_a_half_finished_scene_says_what_is_missing(word_scene, lost):
    """The error names the artifact and the command that makes it."""
    folder = word_scene()
    shutil.rmtree(folder / f"{lost}.zarr")
    with pytest.raises(UserError, match=rf"{lost}\.zarr: does not exist; make it: snakemake"):
        questions_of(folder)


def test_a_scene_without_gaussians_cannot_be_shown(word_scene):
    """There is nothing to look at before the stage splats."""
    folder = word_scene()
    shutil.rmtree(folder / "splats.zarr")
    with pytest.raises(UserError, match=r"lacks splats\.zarr"):
        open_scene(folder, "cpu")


def test_a_variant_shares_what_it_does_not_change(word_scene):
    """A variant's folder with its own language is opened with the other artifacts of its scene."""
    folder = word_scene()
    variant = folder / "variants" / "mine"
    variant.mkdir(parents=True)
    shutil.move(folder / "language.zarr", variant)
    assert questions_of(variant).ask("cup").things


def test_another_openclip_is_named(word_scene):
    """Features of another model are not compared with these words."""
    with pytest.raises(UserError, match="made with another OpenCLIP"):
        questions_of(word_scene(clip_hash="0123456789abcdef"))


def test_words_of_users_are_escaped(word_scene):
    """A phrase with markup is shown as it was typed."""
    questions = questions_of(word_scene())
    told = reply_text(questions.ask("<b>cup</b>"), questions, "m")
    assert "&lt;b&gt;cup&lt;/b&gt;" in told and "<b>cup" not in told
    named = questions.name(np.zeros(3), np.array([0.5, 0.1, 2.0]))
    told = named_text(named, questions.levels, {"whole": 7}, "scene units")
    assert "scene units" in told and "whole (instance 7): cup" in told and "part: no known word fits" in told
