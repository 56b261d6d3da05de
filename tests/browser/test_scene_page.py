"""The scene page in a real browser, against Python."""

import base64
import io
import re

import numpy as np
import pytest
import torch
from PIL import Image

from egosplat.artifacts.schemas import GAUSSIANS
from egosplat.gaussians.render import render
from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.grades import grading_of, measure_evidence
from egosplat.query.relevancy import relevancy
from egosplat.query.scene import QueryScene
from egosplat.query.text import encode_phrases, encode_texts
from egosplat.query.things import find_things
from egosplat.viewing.words import words_to_try
from tests.browser.conftest import ASK, PHONE, READY, WIDE
from tests.support.page_scene import (
    PUT_DOWN,
    SETTINGS,
    TAKEN_UP,
    TITLE,
    contents_of,
    page_options,
    put_histories,
    put_page_scene,
    surface_of,
    write_page,
)

CLIP_HASH = model_hash(CLIP, {"clip_model": "small", "clip_checkpoint": "small"})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The Gaussians, the page's file, and its facts and arrays."""
    folder = tmp_path_factory.mktemp("page")
    gaussians = put_page_scene(folder)
    page = write_page(folder)
    return gaussians, page, *contents_of(page)


@pytest.fixture(scope="module")
def clip():
    return load_open_clip("small", "small", "cpu", "float32")


@pytest.fixture
def scene(made, open_tab):
    """``scene(size)``: a tab with the page, its first picture drawn."""

    def open_page(size=WIDE, touch=False):
        tab = open_tab(size, touch)
        tab.page.goto(made[1].as_uri())
        tab.page.wait_for_function(READY)
        return tab

    return open_page


def color_at(tab, point) -> np.ndarray:
    """(3,) color in a screenshot, around the place where a world point is drawn."""
    tab.page.evaluate("egosplat.idle")
    # The ring of the mark and the panel cover points.
    tab.page.add_style_tag(content="#mark, #panel { visibility: hidden }")
    x, y = tab.page.evaluate("point => egosplat.project(point)", point)
    picture = np.asarray(Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB"), float)
    return picture[round(y) - 3 : round(y) + 4, round(x) - 3 : round(x) + 4].mean(axis=(0, 1))


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_page_opens_without_an_error_or_a_request(scene, size):
    """Everything is in the file, and nothing sticks out of the window."""
    tab = scene(size)
    assert tab.errors == []
    assert len(tab.requests) == 1 and tab.requests[0].startswith("file:")
    assert tab.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for name in ("#words", "#frame", "#title"):
        box = tab.page.locator(name).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= size[0] and box["y"] + box["height"] <= size[1]


def test_the_first_view_is_the_one_that_shows_most(scene):
    """Frame 2 is in the middle of the wall; the views at its ends show less of it. Frame 3 has no pose."""
    tab = scene()
    counts = tab.page.evaluate(
        "egosplat.scene.views.map(({ frame, share }) => [frame, share.filter((one) => one > 0).length])"
    )
    most = max(counts, key=lambda pair: pair[1])[0]
    assert most == 2 and {frame for frame, _ in counts} <= {0, 1, 2, 4}
    assert (
        tab.page.evaluate("egosplat.scene.facts.frames[Number(document.getElementById('frame').value)]")
        == most
    )


def test_the_answer_follows_the_time_line(tmp_path, open_tab):
    """The cup is carried from 0.1 s to 0.2 s, frames 1 and 2: before, it is at one end of the wall, afterwards at the other."""
    put_page_scene(tmp_path)
    put_histories(tmp_path)
    tab = open_tab(WIDE)
    tab.page.goto(write_page(tmp_path).as_uri())
    tab.page.wait_for_function(READY)
    answer = tab.page.evaluate(ASK, "cup")
    assert answer["things"], "it is found where it stands, too"
    assert tab.page.locator("#history button").all_inner_texts() == [
        "→ Carried 0:00 to 0:00\nfrom -1.00, 0.00, 2.00 to 1.00, 0.00, 2.00 m"
    ]
    bar = tab.page.evaluate("document.querySelector('#carried i').style.left")
    assert bar == "25%", "0.1 s of 0.4 s"
    points = {}
    for row, frame in enumerate((0, 1, 2, 4)):
        tab.page.evaluate("row => egosplat.showFrame(row)", row)
        points[frame] = tab.page.evaluate("egosplat.mark && egosplat.mark.point")
    assert points == {0: list(TAKEN_UP), 1: None, 2: None, 4: list(PUT_DOWN)}
    tab.page.evaluate(ASK, "couch")
    assert tab.page.locator("#history button").count() == 0
    tab.page.evaluate("egosplat.showFrame(0)")
    assert tab.page.evaluate("egosplat.mark.point") != list(TAKEN_UP), "the ring stays at the couch"
    assert tab.errors == []


def test_what_rests_is_drawn_at_its_time(tmp_path, open_tab):
    """Red where the cup is taken up and put down; the history is told from rest to rest, and no answer changes."""
    gaussians = put_page_scene(tmp_path)
    put_histories(tmp_path, ((0, 1), (4, 4)))
    tab = open_tab(WIDE)
    tab.page.goto(write_page(tmp_path).as_uri())
    tab.page.wait_for_function(READY)
    assert tab.page.evaluate("[egosplat.scene.count, egosplat.scene.drawn]") == [
        gaussians.count,
        gaussians.count + 8,
    ]
    view = [np.eye(4)[:3].ravel().tolist(), 300.0]

    def reds(places=(TAKEN_UP, PUT_DOWN)):
        tab.page.evaluate("([pose, focal]) => egosplat.setView(pose, focal)", view)
        colors = [color_at(tab, [0.95 * x, y, 1.6]) for x, y, _ in places]
        return [bool(red > green + 60) for red, green, _ in colors]

    found = {}
    for row, frame in enumerate((0, 1, 2, 4)):
        tab.page.evaluate("row => egosplat.showFrame(row)", row)
        found[frame] = reds()
    assert found == {0: [True, False], 1: [True, False], 2: [False, False], 4: [False, True]}
    tab.page.evaluate("row => egosplat.showFrame(row)", 3)
    answer = tab.page.evaluate(ASK, "cup")
    assert answer["things"] and reds() == [False, False], "what is not asked for is gray"
    assert tab.page.evaluate("document.querySelector('#carried i').style.left") == "25%"
    assert tab.page.evaluate("egosplat.history.history.map(({ from, until }) => [from, until])") == [
        [0.1, 0.4]
    ]
    tab.page.evaluate("egosplat.clear()")
    assert reds() == [False, True]
    assert tab.errors == []


def test_the_title_is_shown_as_text(scene):
    """HTML in a title stays text."""
    tab = scene()
    assert tab.page.inner_text("#title") == f"{TITLE} (synthetic)"
    assert tab.page.locator("#injected").count() == 0


def test_the_picture_is_that_of_the_kernels(scene, made):
    """The browser draws what egosplat renders, quantization included."""
    tab = scene()
    pose, focal = np.eye(4), 300.0
    tab.page.evaluate("([pose, focal]) => egosplat.setView(pose, focal)", [pose[:3].ravel().tolist(), focal])
    address = tab.page.evaluate("egosplat.picture()")
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGB"))
    height, width = drawn.shape[:2]
    camera = Camera(width, height, focal, focal, width / 2, height / 2)
    expected = render(made[0], camera, pose, SETTINGS, sh_degree=1, background=None)[0].clamp(0, 1).numpy()
    error = float(((drawn / 255.0 - expected) ** 2).mean())
    assert -10 * np.log10(error) > 40


@pytest.mark.parametrize("words", ["red couch", "blue cup", "wooden door"])
def test_an_answer_is_that_of_python(scene, made, clip, words):
    """Place, level, score and best frame of every thing found equal those of the package on the page's data."""
    _, _, facts, arrays = made
    options = page_options()
    canonical = encode_phrases(clip, options.canonical)
    features = torch.from_numpy(arrays["palette"].astype(np.float32))
    fits = relevancy(features, encode_phrases(clip, [words]), canonical, options.temperature)[..., 0].numpy()
    surface = surface_of(facts, arrays)
    values = np.stack([fits[level][arrays["code_index"][level]] for level in range(2)])
    values = np.where(surface.weight.T > 0, values, np.float32(0))
    things = find_things(surface, values, options.segmentation_threshold, options.box_filter, 3)
    code = torch.stack(
        [features[level][arrays["code_index"][level].astype(int)] for level in range(2)], dim=1
    )
    share = torch.from_numpy(surface.weight > 0).float()
    decoder = Decoder((code.shape[2],), np.zeros(0, np.float32))
    known = QueryScene(None, None, None, 0, code, share, decoder, GAUSSIANS, facts["levels"])
    texts, names = (encode_texts(clip, phrases, options.canonical) for phrases in ([words], facts["words"]))
    grading = grading_of(CLIP_HASH, options)
    evidence = measure_evidence(known, surface, things, texts, names, options.temperature)
    ratings = list(map(grading.calibration.probability, evidence))
    found = scene().page.evaluate(ASK, words)
    assert found["score"] == pytest.approx(things[0].score, abs=1e-3)
    assert found["grade"] == grading.grade(ratings[0]) and found["rating"] == pytest.approx(
        ratings[0], abs=1e-3
    )
    fitting = [
        row for row in range(len(things)) if grading.grade(ratings[row]) == found["grade"] != "not found"
    ]
    assert len(found["things"]) == len(fitting)
    for mine, row in zip(found["things"], fitting, strict=True):
        other = things[row]
        assert mine["rating"] == pytest.approx(ratings[row], abs=1e-3)
        assert facts["levels"][mine["level"]] == other.level and mine["count"] == len(other.members)
        assert mine["frame"] == other.frame
        np.testing.assert_allclose(mine["center"], other.center, atol=1e-3)
        np.testing.assert_allclose(mine["size"], other.size, atol=1e-3)


def test_a_word_of_the_list_has_the_answer_of_the_terminal(scene, made):
    """The page shows what the package judged, and judges nothing itself."""
    facts, page = made[2], scene().page
    for word, answer in zip(facts["words"], facts["answers"], strict=True):
        found = page.evaluate(ASK, word)
        assert {name: found[name] for name in ("grade", "score", "rating", "why")} == {
            name: answer[name] for name in ("grade", "score", "rating", "why")
        }
        assert [one["frame"] for one in found["things"]] == [one["frame"] for one in answer["things"]]


def test_a_query_colors_its_answer_and_a_jump_shows_it(scene):
    """The pixel under the answer is hot, one beside it is grey; after the jump the answer is in the middle."""
    tab = scene()
    # What is told follows the view.
    away = [1, 0, 0, -9, 0, 1, 0, 0, 0, 0, 1, 0]
    tab.page.evaluate("pose => egosplat.setView(pose)", away)
    tab.page.fill("#words", "cup")
    tab.page.press("#words", "Enter")
    tab.page.locator("#answer", has_text="outside of the view").wait_for()
    button = tab.page.locator("#things button").first
    button.wait_for()
    thing = tab.page.evaluate(ASK, "cup")["things"][0]
    assert thing["center"][0] > 0.7
    assert tab.page.evaluate("point => egosplat.project(point)", thing["center"]) is None
    button.click()
    x, y = tab.page.evaluate("point => egosplat.project(point)", thing["center"])
    assert [x, y] == pytest.approx([WIDE[0] / 2, WIDE[1] / 2], abs=1)
    # The mark is drawn with the next frame.
    tab.page.locator("#mark span", has_text=re.compile(r"^cup")).wait_for()
    assert "outside" not in tab.page.inner_text("#answer")
    wall = [0.1, 0.0, 2.0]
    red, _, blue = color_at(tab, thing["center"])
    assert red > 2 * blue
    assert color_at(tab, wall).max() - color_at(tab, wall).min() < 10
    tab.page.evaluate("egosplat.show({ only: true })")
    assert color_at(tab, thing["center"])[0] > 2 * blue
    assert color_at(tab, wall).max() < 40


def test_a_click_names_what_is_there(scene):
    """The words that fit best, their level, the position and the instances of a surface."""
    tab = scene()
    tab.page.evaluate("egosplat.setView([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], 300)")
    x, y = tab.page.evaluate("egosplat.project([0.9, 0.3, 2])")
    tab.page.mouse.click(x, y)
    text = tab.page.inner_text("#place")
    assert text.startswith("cup ") and "(whole)" in text and "whole 5" in text
    found = tab.page.evaluate("([x, y]) => egosplat.explain(x, y).point", [x, y])
    np.testing.assert_allclose(found, [0.9, 0.3, 2.0], atol=0.15)
    tab.page.mouse.click(790, 5)
    assert tab.page.inner_text("#place") == "Nothing is there."


def test_shown_scores_never_contradict_the_verdict(scene):
    """As in Python, a score is rounded to its own side of the limit, and a probability to its own grade."""
    shown = "score => egosplat.score(score)"
    tab = scene()
    least = tab.page.evaluate("egosplat.scene.facts.query.min_score")
    assert tab.page.evaluate(shown, least) == f"{least:.2f}"
    assert (
        float(tab.page.evaluate(shown, least - 1e-6)) < least <= float(tab.page.evaluate(shown, least + 1e-6))
    )
    assert tab.page.evaluate(shown, least - 0.1) == f"{least - 0.1:.2f}"
    grading = grading_of(CLIP_HASH, page_options())
    for limit in (grading.calibration.found, grading.calibration.guess):
        for value in (limit - 1e-6, limit, limit + 1e-6, limit - 0.006):
            assert tab.page.evaluate("value => egosplat.rating(value)", value) == grading.shown(value)


def test_a_best_guess_is_shown_as_one_with_its_place(scene):
    """Between the limits an answer keeps its place, and says what it is."""
    tab = scene()
    tab.page.evaluate("Object.assign(egosplat.scene.facts.query.calibration, { found: 1.01, guess: 0.0 })")
    found = tab.page.evaluate(ASK, "red cup")
    assert found["grade"] == "best guess" and found["things"] and found["why"] is None
    assert "best guess" in tab.page.inner_text("#answer") and "found" not in tab.page.inner_text("#answer")
    button = tab.page.locator("#things button").first
    assert "Go there: best guess" in button.inner_text()
    button.click()
    tab.page.locator("#mark span", has_text="best guess").wait_for()


def test_words_and_tokens_are_those_of_the_model(scene, clip):
    """The text tower in JavaScript gives PyTorch's features, for words that are not in the page's list too."""
    tab = scene()
    phrases = ["couch", "red wooden chair", "the lamp's  shade, on a desk!", "café 24", "Ein Bücherregal?"]
    for phrase in phrases:
        tokens = tab.page.evaluate("phrase => egosplat.tower.tokenize(phrase)", phrase)
        assert tokens == clip.tokenizer.encode(phrase)
    encoded = [
        tab.page.evaluate("p => Array.from(egosplat.tower.encode(egosplat.tower.tokenize(p)))", phrase)
        for phrase in phrases
    ]
    np.testing.assert_allclose(encoded, encode_phrases(clip, phrases).numpy(), atol=1e-6)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("zeppelin", "never taught the word"),
        ("<img src=x onerror=\"document.title = 'hacked'\">", "<img"),
        ("x" * 10_000, "too long"),
        (" \u200b", "Type the name"),
        *((symbols, "no word") for symbols in ("::", "%", "\U0001f600", "\u2122", "_")),
        ("\uff42asketball\u200b", "not found: nothing here looks like it (probability 0.0"),
        ("basketball", "not found: nothing here looks like it (probability 0.0"),
    ],
)
def test_what_cannot_be_found_gets_a_reason(scene, words, reason):
    """Unknown words, HTML, 10,000 letters, nothing, and a thing that is not there."""
    tab = scene()
    tab.page.fill("#words", words)
    tab.page.press("#words", "Enter")
    tab.page.wait_for_function(
        "reason => document.getElementById('answer').textContent.includes(reason)", arg=reason
    )
    assert tab.page.locator("#answer img").count() == 0 and tab.page.title() != "hacked"
    assert len(tab.page.inner_text("#answer")) < 300
    assert tab.page.locator("#things button").count() == 0 and tab.errors == []


@pytest.mark.parametrize("touch", [False, True])
def test_the_view_follows_slider_keys_wheel_and_drags(scene, touch):
    """The slider stands where the wearer stood; keys, wheel and drags move on from there."""
    tab = scene(PHONE if touch else WIDE, touch)
    eye = "Array.from(egosplat.camera.eye)"
    tab.page.locator("#frame").fill("0")
    assert tab.page.evaluate(eye) == pytest.approx([-0.8, 0, 0])
    assert "frame 0" in tab.page.inner_text("#clock")
    places = [tab.page.evaluate(eye)]
    if touch:
        tab.page.touchscreen.tap(195, 150)
        assert tab.page.inner_text("#place").startswith("couch")
    tab.page.focus("#view")
    tab.page.keyboard.press("ArrowUp")
    places.append(tab.page.evaluate(eye))
    tab.page.mouse.move(330, 150)
    tab.page.mouse.wheel(0, -200)
    tab.page.wait_for_function(f"before => {eye}[2] > before", arg=places[1][2])
    places.append(tab.page.evaluate(eye))
    assert 0 < places[1][2] < places[2][2] < 2
    tab.page.mouse.down()
    tab.page.mouse.move(380, 180)
    tab.page.mouse.up()
    assert np.linalg.norm(np.subtract(tab.page.evaluate(eye), places[2])) > 0.05
    assert tab.errors == []


def test_instances_have_colors_and_the_words_are_suggested(scene, clip):
    """Neighbors of different instances differ in color; the vocabulary is that of the model."""
    tab = scene()
    tab.page.check("#instances")
    left, right = color_at(tab, [0.35, 0.2, 2]), color_at(tab, [0.75, 0.2, 2])
    assert np.abs(left - right).max() > 30
    # A question shows its answer, and the instances can be shown again.
    tab.page.evaluate(ASK, "cup")
    assert not tab.page.is_checked("#instances")
    assert np.ptp(color_at(tab, [0.1, 0.0, 2])) < 10
    tab.page.evaluate("egosplat.show({ instances: true })")
    np.testing.assert_allclose(color_at(tab, [0.35, 0.2, 2]), left, atol=3)
    options = tab.page.eval_on_selector_all("#vocabulary option", "all => all.map(one => one.value)")
    assert options == list(words_to_try(clip))


def test_cameras_show_where_photographs_were_taken(scene):
    """A frustum for each frame with a pose, at its place; a click on one stands there, where it is hidden."""
    tab = scene()
    # Among the cameras none is in view, and the viewer steps back.
    tab.page.check("#cameras")
    assert tab.page.evaluate("egosplat.camera.eye[2]") < -0.5
    tab.page.uncheck("#cameras")
    behind = [1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, -2.5]
    tab.page.evaluate("pose => egosplat.setView(pose)", behind)
    assert tab.page.evaluate("egosplat.cameraAt(400, 250)") is None
    tab.page.check("#cameras")
    tab.page.wait_for_function("egosplat.cameras.frusta.every(({ image }) => image.naturalWidth > 1)")
    assert tab.page.evaluate("egosplat.cameras.drawn.map(({ row }) => row).sort()") == [0, 1, 2, 3]
    for row, x in enumerate((-0.8, -0.4, 0.0, 0.8)):
        at = tab.page.evaluate("point => egosplat.onScreen(point)", [x, 0, 0.01])
        assert tab.page.evaluate("([x, y]) => egosplat.cameraAt(x, y)", at) == row
    drawn = "egosplat.cameras.canvas.getContext('2d').getImageData(...arguments[0], 1, 1).data[3]"
    alpha = f"(place) => (function () {{ return {drawn} }})(place)"
    assert tab.page.evaluate(alpha, [round(at[0]), round(at[1])]) == 255
    assert tab.page.evaluate(alpha, [5, 5]) == 0
    tab.page.mouse.click(*at)
    assert tab.page.evaluate("Array.from(egosplat.camera.eye)") == pytest.approx([0.8, 0, 0])
    assert "frame 4" in tab.page.inner_text("#clock") and not tab.page.inner_text("#place").startswith(
        "Nothing"
    )
    tab.page.evaluate("egosplat.idle")
    assert 3 not in tab.page.evaluate("egosplat.cameras.drawn.map(({ row }) => row)")
    tab.page.uncheck("#cameras")
    assert not tab.page.is_visible("#cameras-view") and tab.errors == []


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_photograph_of_the_slider_is_shown_larger(scene, size):
    """A press shows the photograph of the slider's frame in the window, the next one hides it; it names its frame."""
    tab = scene(size)
    assert not tab.page.is_visible("#photograph")
    tab.page.click("#enlarge")
    for row, frame in ((0, 0), (3, 4)):
        tab.page.locator("#frame").fill(str(row))
        assert tab.page.inner_text("#photograph") == f"Photograph of frame {frame}"
        picture = "document.querySelector('#photograph img')"
        tab.page.wait_for_function(f"{picture}.complete && {picture}.naturalWidth === 96")
    box = tab.page.locator("#photograph").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= size[0] and box["y"] + box["height"] <= size[1]
    tab.page.click("#enlarge")
    assert not tab.page.is_visible("#photograph") and tab.errors == []


def test_a_thinned_scene_without_a_text_tower_says_so(tmp_path, open_tab, monkeypatch):
    """A page with fewer Gaussians tells how many there are; without a text tower it answers its list alone."""
    put_page_scene(tmp_path, origin="real")
    monkeypatch.setattr("egosplat.viewing.words.MOST_NUMBERS", 1000)
    page = write_page(tmp_path, max_gaussians=400)
    tab = open_tab(PHONE)
    tab.page.goto(page.as_uri())
    tab.page.wait_for_function(READY)
    tab.page.click("summary")
    about = tab.page.inner_text("#about")
    assert "400 of 700" in about and "only the" in about and "real" in about
    assert "trained on synthetic apartments only" in tab.page.inner_text("#warnings")
    assert "list" in tab.page.evaluate(ASK, "red couch")["why"]
    assert tab.page.evaluate(ASK, "couch")["score"] > 0.3 and tab.errors == []
