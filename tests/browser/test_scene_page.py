"""The scene page in a real browser, against Python."""

import base64
import io
import re
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from egosplat.gaussians.render import render
from egosplat.geometry import Camera
from egosplat.language.decoder import Decoder
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.query.contest import leads_of
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import LEAST_FOUND, LEAST_GUESS, grading_of, measure_evidence
from egosplat.query.reading import read_questions
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
    wall,
    write_page,
)
from tests.unit.query.test_reading import CASES, PLAIN

BAR = "Number.parseFloat(document.querySelector('#carried i').style.left)"
SET_VIEW, AHEAD = "([pose, focal]) => egosplat.setView(pose, focal)", [np.eye(4)[:3].ravel().tolist(), 300.0]
CLIP_HASH = model_hash(CLIP, {"clip_model": "small", "clip_checkpoint": "small"})


@pytest.fixture(scope="module")
def data(page_scene):
    """The facts and arrays of the page."""
    return contents_of(page_scene / "scene.html")


@pytest.fixture
def scene(page_scene, open_tab):
    """``scene(size, touch, page)``: a tab with the page, its first picture drawn."""

    def open_page(size=WIDE, touch=False, page=page_scene / "scene.html"):
        tab = open_tab(size, touch)
        tab.goto(page.as_uri())
        tab.wait_for_function(READY)
        return tab

    return open_page


@pytest.fixture
def scene_in_time(page_scene, scene, tmp_path):
    """``scene_in_time(spans)``: ``scene`` with histories."""

    def open_page(*spans):
        folder = shutil.copytree(page_scene, tmp_path / "scene")
        put_histories(folder, *spans)
        return scene(page=write_page(folder))

    return open_page


def fits(page, name: str, size) -> bool:
    """Whether an element lies in the window."""
    box = page.locator(name).bounding_box()
    return box["x"] >= 0 and box["x"] + box["width"] <= size[0] and box["y"] + box["height"] <= size[1]


def color_at(tab, point) -> np.ndarray:
    """(3,) color in a screenshot, around the place where a world point is drawn."""
    tab.evaluate("egosplat.idle")
    # The ring of the mark and the panel cover points.
    tab.add_style_tag(content="#mark, #panel { visibility: hidden }")
    x, y = tab.evaluate("point => egosplat.project(point)", point)
    picture = np.asarray(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"), float)
    return picture[round(y) - 3 : round(y) + 4, round(x) - 3 : round(x) + 4].mean(axis=(0, 1))


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_page_opens_whole_at_the_view_that_shows_most(scene, size):
    page = scene(size)
    assert page.errors == []
    assert len(page.requests) == 1 and page.requests[0].startswith("file:")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert all(fits(page, name, size) for name in ("#words", "#frame", "#title"))
    # HTML in a title stays text.
    assert page.inner_text("#title") == f"{TITLE} (synthetic)" and page.locator("#injected").count() == 0
    # Frame 2 is in the middle of the wall; the views at its ends show less of it. Frame 3 has no pose.
    seen = "({ frame, share }) => [frame, share.filter((one) => one > 0).length]"
    counts = dict(page.evaluate(f"egosplat.scene.views.map({seen})"))
    first = "egosplat.scene.facts.frames[Number(document.getElementById('frame').value)]"
    assert max(counts, key=counts.get) == page.evaluate(first) == 2 and {*counts} <= {0, 1, 2, 4}


def test_the_answer_follows_the_time_line(scene_in_time):
    """The cup is carried from 0.1 s to 0.2 s, frames 1 and 2: before, it is at one end of the wall, afterwards at the other."""
    page = scene_in_time()
    mark = "egosplat.mark && egosplat.mark.point"
    assert page.evaluate(ASK, "cup")["things"], "it is found where it stands, too"
    [carried] = page.locator("#history button").all_inner_texts()
    assert carried == "→ Carried from 0:00 to 0:00\nfrom -1.00, 0.00, 2.00 to 1.00, 0.00, 2.00 m"
    assert page.evaluate(BAR) == pytest.approx(100 / 3, abs=0.01), "below the slider at the second of four"
    points = {}
    for row, frame in enumerate((0, 1, 2, 4)):
        page.evaluate("row => egosplat.showFrame(row)", row)
        points[frame] = page.evaluate(mark)
    assert points == {0: list(TAKEN_UP), 1: None, 2: None, 4: list(PUT_DOWN)}
    page.evaluate(ASK, "couch")
    assert page.locator("#history button").count() == 0
    page.evaluate("egosplat.showFrame(0)")
    assert page.evaluate(mark) != list(TAKEN_UP), "the ring stays at the couch"
    assert page.errors == []


def test_what_rests_is_drawn_at_its_time(scene_in_time):
    """Red where the cup is taken up and put down; the history is told from rest to rest, and no answer changes."""
    page = scene_in_time(((0, 1), (4, 4)))
    assert page.evaluate("[egosplat.scene.count, egosplat.scene.drawn]") == [700, 708]

    def reds(row=None):
        if row is not None:
            page.evaluate("row => egosplat.showFrame(row)", row)
        page.evaluate(SET_VIEW, AHEAD)
        colors = [color_at(page, [0.95 * x, y, 1.6]) for x, y, _ in (TAKEN_UP, PUT_DOWN)]
        return [bool(red > green + 60) for red, green, _ in colors]

    assert [reds(row) for row in range(4)] == [[True, False], [True, False], [False, False], [False, True]]
    answer = page.evaluate(ASK, "cup")
    assert answer["things"] and reds() == [False, False], "what is not asked for is gray"
    assert page.evaluate("egosplat.history.history.map(({ from, until }) => [from, until])") == [[0.1, 0.4]]
    page.evaluate("egosplat.clear()")
    assert reds() == [False, True] and page.errors == []


def test_the_picture_is_that_of_the_kernels(scene):
    page = scene()
    page.evaluate(SET_VIEW, AHEAD)
    address = page.evaluate("egosplat.picture()")
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGB"))
    height, width = drawn.shape[:2]
    camera = Camera(width, height, 300.0, 300.0, width / 2, height / 2)
    expected, _, _ = render(wall(), camera, np.eye(4), SETTINGS, sh_degree=1, background=None)
    error = float(((drawn / 255.0 - expected.clamp(0, 1).numpy()) ** 2).mean())
    assert -10 * np.log10(error) > 40


@pytest.mark.parametrize("words", ["red couch", "blue cup", "wooden door"])
def test_an_answer_is_that_of_python(scene, page_scene, data, clip, words):
    (facts, arrays), options = data, page_options()
    features = torch.from_numpy(arrays["palette"].astype(np.float32))
    surface, index = surface_of(facts, arrays), arrays["code_index"].astype(int)
    code = torch.stack([features[level][index[level]] for level in range(2)], dim=1)
    share = torch.from_numpy(surface.weight > 0).float()
    decoder = Decoder((code.shape[2],), np.zeros(0, np.float32))
    instance = torch.from_numpy(arrays["instance"].T.astype(np.int64)) - 1
    sizes = replace(open_scene(page_scene).asked.sizes, instance=instance)
    known = QueryScene(None, None, None, 0, code, share, decoder, facts["levels"], sizes=sizes)
    asked, every = (encode_texts(clip, each, options) for each in ([words], facts["words"]))
    [values] = known.relevancy(asked, options).numpy()
    things = find_things(surface, values, options.segmentation_threshold, options.box_filter, 3)
    grading = grading_of(CLIP_HASH, options)
    leads = leads_of(known, things, asked, every, options)
    ratings = [*map(grading.calibration.probability, measure_evidence(things, leads, facts["levels"]))]
    found = scene().evaluate(ASK, words)
    assert (found["score"], found["rating"]) == pytest.approx((things[0].score, ratings[0]), abs=1e-3)
    assert found["grade"] == grading.grade(ratings[0])
    graded = zip(things, ratings, strict=True)
    fitting = [pair for pair in graded if grading.grade(pair[1]) == found["grade"] != "not found"]
    for mine, (other, rating) in zip(found["things"], fitting, strict=True):
        assert mine["rating"] == pytest.approx(rating, abs=1e-3)
        assert facts["levels"][mine["level"]] == other.level
        assert (mine["count"], mine["frame"]) == (len(other.members), other.frame)
        np.testing.assert_allclose(mine["center"], other.center, atol=1e-3)
        np.testing.assert_allclose(mine["size"], other.size, atol=1e-3)


def test_a_query_colors_its_answer_and_a_jump_shows_it(scene):
    page, project = scene(), "point => egosplat.project(point)"
    # What is told follows the view.
    page.evaluate("egosplat.setView([1, 0, 0, -9, 0, 1, 0, 0, 0, 0, 1, 0])")
    page.fill("#words", "cup")
    page.press("#words", "Enter")
    page.locator("#answer", has_text="outside of the view").wait_for()
    button = page.locator("#things button").first
    button.wait_for()
    center = page.evaluate(ASK, "cup")["things"][0]["center"]
    assert center[0] > 0.7 and page.evaluate(project, center) is None
    button.click()
    assert page.evaluate(project, center) == pytest.approx([WIDE[0] / 2, WIDE[1] / 2], abs=1)
    # The mark is drawn with the next frame.
    page.locator("#mark span", has_text=re.compile(r"^cup")).wait_for()
    assert "outside" not in page.inner_text("#answer")
    beside = [0.1, 0.0, 2.0]
    red, _, blue = color_at(page, center)
    assert red > 2 * blue and np.ptp(color_at(page, beside)) < 10
    page.evaluate("egosplat.show({ only: true })")
    assert color_at(page, center)[0] > 2 * blue and color_at(page, beside).max() < 40


def test_the_list_of_what_is_here_goes_to_each_thing_and_tells_what_is_carried(scene_in_time):
    page = scene_in_time().page
    assert page.inner_text("#inventory summary") == "What is here (4)"
    page.click("#inventory summary")
    assert page.locator("#catalog b").all_inner_texts() == ["cup", "wall", "couch", "cup"]
    page.locator("#catalog button").nth(0).click()
    page.locator("#mark span", has_text=re.compile(r"^cup")).wait_for()
    assert page.inner_text("#answer") == "cup" and not page.locator("#heat").is_visible()
    page.locator("#catalog button").nth(3).click()
    page.locator("#history button", has_text="Carried").first.wait_for()


def test_judgements_of_answers_are_kept_as_a_file_for_calibrate(scene):
    page = scene()
    for word, kind in (("couch", "Right"), ("cup", "Wrong"), ("wall", "Right"), ("wall", "Not here")):
        page.evaluate(ASK, word)
        page.get_by_role("button", name=kind, exact=True).click()
    with page.expect_download() as download:
        page.click("#labels")
    assert download.value.path().read_text() == 'phrase,label\n"couch",right\n"cup",wrong\n"wall",absent\n'


def test_a_click_names_what_is_there(scene):
    page = scene()
    page.evaluate(SET_VIEW, AHEAD)
    x, y = page.evaluate("egosplat.project([0.9, 0.3, 2])")
    page.mouse.click(x, y)
    text = page.inner_text("#place")
    assert text.startswith("cup ") and "(whole, relevancy " in text and "whole 5" in text
    found = page.evaluate("([x, y]) => egosplat.explain(x, y).point", [x, y])
    np.testing.assert_allclose(found, [0.9, 0.3, 2.0], atol=0.15)
    page.mouse.click(790, 5)
    assert page.inner_text("#place") == "Nothing is there."


def test_shown_scores_never_contradict_the_verdict_and_a_best_guess_is_shown_as_one_with_its_place(scene):
    """As in Python, a score is rounded to its own side of the limit, and a probability to its own grade."""
    page, shown = scene(), "score => egosplat.score(score)"
    least = page.evaluate("egosplat.scene.facts.query.min_score")
    for score in (least, least - 0.1):
        assert page.evaluate(shown, score) == f"{score:.2f}"
    below, above = (float(page.evaluate(shown, score)) for score in (least - 1e-6, least + 1e-6))
    assert below < least <= above
    grading = grading_of(CLIP_HASH, page_options())
    for limit in (LEAST_FOUND, LEAST_GUESS):
        for value in (limit - 1e-6, limit, limit + 1e-6, limit - 0.006):
            assert page.evaluate("value => egosplat.rating(value)", value) == grading.shown(value)
    page.evaluate("Object.assign(egosplat.scene.facts.query, { found: 1.01, guess: 0.0 })")
    found = page.evaluate(ASK, "red cup")
    assert found["grade"] == "best guess" and found["things"] and found["why"] is None
    assert "best guess" in page.inner_text("#answer") and "found" not in page.inner_text("#answer")
    button = page.locator("#things button").first
    assert "Go there: best guess" in button.inner_text()
    button.click()
    page.locator("#mark span", has_text="best guess").wait_for()


def test_words_and_tokens_are_those_of_the_model(scene, clip):
    """The text tower in JavaScript gives PyTorch's features, for words that are not in the page's list too."""
    phrases = ["couch", "red wooden chair", "the lamp's  shade, on a desk!", "café 24", "Ein Bücherregal?"]
    page, encoded = scene(), []
    for phrase in phrases:
        tokens = page.evaluate("phrase => egosplat.tower.tokenize(phrase)", phrase)
        assert tokens == clip.tokenizer.encode(phrase)
        encoded.append(page.evaluate("tokens => Array.from(egosplat.tower.encode(tokens))", tokens))
    np.testing.assert_allclose(encoded, encode_phrases(clip, phrases).numpy(), atol=1e-6)


def test_a_question_is_read_as_in_python(scene, clip):
    told = "text => egosplat.read(text).map(({ name, relation }) => [name.toLowerCase(), !!relation])"
    page = scene()
    for text in [*dict(CASES), *map(str.strip, PLAIN.split(";"))]:
        asked = read_questions(clip, text, words_to_try(clip))
        assert page.evaluate(told, text) == [[one.phrase.lower(), bool(one.relation)] for one in asked], text


def test_a_file_answers_lists_and_near_words_and_names_the_command_for_the_rest(
    page_scene, scene, tmp_path, run_command
):
    page = scene()

    def ask(text):
        page.evaluate(ASK, text)
        return page.inner_text("#answer")

    assert ask("where are my cups?").startswith('"where are my cups?" (read as: cup): found')
    told = '"couch, cup, cups and zeppelin":\ncouch: found\ncup: found\nzeppelin: .*taught.*'
    assert re.fullmatch(told, ask("couch, cup, cups and zeppelin"))
    assert page.locator("#things b").all_inner_texts() == ["couch", "cup"]
    assert "cup" in ask("what is here?") and 'Did you mean "red couch"?' in ask("the red coutch")
    page.click("#things button")
    page.locator("#answer", has_text='"red couch": ').wait_for()
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    command, _, *words = shlex.split(ask("is the cup next to my wall?").partition("by egosplat ")[2])
    _, out, _ = run_command(command, folder, *words)
    assert "\ncup next to wall" in out and page.errors == []


UNFOUND = {symbols: "no word" for symbols in ("::", "%", "\U0001f600", "\u2122", "_")}
UNFOUND |= dict.fromkeys(("\uff42asketball\u200b", "basketball"), "looks like it (probability 0.0")
UNFOUND |= {"zeppelin": "never taught the word", "x" * 10_000: "too long", " \u200b": "Type the name"}
UNFOUND["<img src=x onerror=\"document.title = 'hacked'\">"] = "<img"


def test_what_cannot_be_found_gets_a_reason(scene):
    page = scene()
    text = "document.getElementById('answer').textContent"
    for words, reason in UNFOUND.items():
        page.evaluate("egosplat.clear()")
        page.fill("#words", words)
        page.press("#words", "Enter")
        page.wait_for_function(f"reason => {text}.includes(reason) && !{text}.endsWith(' ...')", arg=reason)
        assert page.locator("#answer img").count() == 0 and page.title() != "hacked"
        assert len(page.inner_text("#answer")) < 300
        assert page.locator("#things button").count() == 0 and page.errors == []


@pytest.mark.parametrize("touch", [False, True])
def test_the_view_follows_slider_keys_wheel_and_drags(scene, touch):
    page, eye = scene(PHONE if touch else WIDE, touch), "Array.from(egosplat.camera.eye)"
    # The slider stands where the wearer stood.
    page.locator("#frame").fill("0")
    assert page.evaluate(eye) == pytest.approx([-0.8, 0, 0])
    assert page.get_attribute("#frame", "aria-valuetext") == page.inner_text("#clock") == "0.0 s, frame 0"
    if touch:
        page.touchscreen.tap(195, 150)
        assert page.inner_text("#place").startswith("couch")
    page.focus("#view")
    page.keyboard.press("Enter")
    page.keyboard.press("Shift+ArrowRight")
    assert page.inner_text("#place")[:5] == "couch" and page.evaluate("egosplat.camera.forward[0]") > 0.05
    page.keyboard.press("ArrowUp")
    for act, key in (("down", "KeyW"), ("down", "Control"), ("up", "KeyW"), ("up", "Control")):
        getattr(page.keyboard, act)(key)
    assert page.evaluate("egosplat.controls.keys.size") == 0, "a key that is let go moves no more"
    near = page.evaluate(eye)
    page.mouse.move(330, 150)
    page.mouse.wheel(0, -200)
    page.wait_for_function(f"before => {eye}[2] > before", arg=near[2])
    nearer = page.evaluate(eye)
    assert 0 < near[2] < nearer[2] < 2
    page.mouse.down()
    page.mouse.move(380, 180)
    page.mouse.up()
    assert np.linalg.norm(np.subtract(page.evaluate(eye), nearer)) > 0.05
    assert page.errors == []


def test_instances_have_colors_and_the_words_are_suggested(scene, clip):
    tab = scene()
    tab.check("#instances")
    left, right = color_at(tab, [0.35, 0.2, 2]), color_at(tab, [0.75, 0.2, 2])
    assert np.abs(left - right).max() > 30
    # A question shows its answer, and the instances can be shown again.
    tab.evaluate(ASK, "cup")
    assert not tab.is_checked("#instances") and np.ptp(color_at(tab, [0.1, 0.0, 2])) < 10
    tab.evaluate("egosplat.show({ instances: true })")
    np.testing.assert_allclose(color_at(tab, [0.35, 0.2, 2]), left, atol=3)
    options = tab.eval_on_selector_all("#vocabulary option", "all => all.map(one => one.value)")
    assert options == list(words_to_try(clip))
    tab.evaluate("words.value = 'couch'; words.dispatchEvent(new Event('input'))")  # a choice in Chromium
    tab.locator("#answer", has_text='"couch": found').wait_for(state="attached")


def test_cameras_show_where_photographs_were_taken(scene):
    """A frustum for each frame with a pose, at its place; a click on one stands there, where it is hidden."""
    page = scene()
    rows = "egosplat.cameras.drawn.map(({ row }) => row).sort()"
    # Among the cameras none is in view, and the viewer steps back.
    page.check("#cameras")
    assert page.evaluate("egosplat.camera.eye[2]") < -0.5
    page.uncheck("#cameras")
    page.evaluate("egosplat.setView([1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, -2.5])")
    assert page.evaluate("egosplat.cameraAt(400, 250)") is None
    page.check("#cameras")
    page.wait_for_function("egosplat.cameras.frusta.every(({ image }) => image.naturalWidth > 1)")
    assert page.evaluate(rows) == [0, 1, 2, 3]
    for row, x in enumerate((-0.8, -0.4, 0.0, 0.8)):
        at = page.evaluate("x => egosplat.onScreen([x, 0, 0.01])", x)
        assert page.evaluate("([x, y]) => egosplat.cameraAt(x, y)", at) == row
    alpha = "([x, y]) => egosplat.cameras.canvas.getContext('2d').getImageData(x, y, 1, 1).data[3]"
    assert [page.evaluate(alpha, place) for place in (list(map(round, at)), [5, 5])] == [255, 0]
    page.mouse.click(*at)
    assert page.evaluate("Array.from(egosplat.camera.eye)") == pytest.approx([0.8, 0, 0])
    assert "frame 4" in page.inner_text("#clock") and not page.inner_text("#place").startswith("Nothing")
    page.evaluate("egosplat.idle")
    assert 3 not in page.evaluate(rows)
    page.uncheck("#cameras")
    assert not page.is_visible("#cameras-view") and page.errors == []


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_a_press_shows_the_photograph_of_the_slider_in_the_window_and_the_next_one_hides_it(scene, size):
    page, picture = scene(size), "document.querySelector('#photograph img')"
    assert not page.is_visible("#photograph")
    page.click("#enlarge")
    for row, frame in ((0, 0), (3, 4)):
        page.locator("#frame").fill(str(row))
        assert page.inner_text("#photograph") == f"Photograph of frame {frame}"
        page.wait_for_function(f"{picture}.complete && {picture}.naturalWidth === 96")
    assert fits(page, "#photograph", size)
    page.click("#enlarge")
    assert not page.is_visible("#photograph") and page.errors == []


def test_a_thinned_scene_without_a_text_tower_says_so(tmp_path, scene, monkeypatch):
    put_page_scene(tmp_path, origin="real")
    monkeypatch.setattr("egosplat.viewing.words.MOST_NUMBERS", 1000)
    page = scene(PHONE, page=write_page(tmp_path, max_gaussians=400))
    page.click("#about summary")
    about = page.inner_text("#about")
    assert "400 of 700" in about and "only the" in about and "real" in about
    assert "trained on synthetic apartments only" in page.inner_text("#warnings")
    assert "FOLDER 'coutch'. Did you mean \"couch\"?" in page.evaluate(ASK, "coutch")["why"]
    assert page.evaluate(ASK, "couch")["score"] > 0.3 and page.errors == []
