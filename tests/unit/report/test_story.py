"""The story of a scene: one page with each step, its picture, its cost and its alarms."""

import re

import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.report.story import run
from tests.support.page_scene import put_histories, put_page_scene


@pytest.fixture
def scene(tmp_path):
    """A plain scene without annotations, survey and masks, and one of its pages."""
    folder = tmp_path / "scene1"
    folder.mkdir()
    put_page_scene(folder)
    put_histories(folder)
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / "language.png")
    (folder / "scene.html").write_text('<!doctype html><p title="a">3 < 4</p>')
    return folder


def told(scene, title="mine/scene") -> str:
    run(sorted(scene.iterdir()), scene.parent / "story.html", title)
    return (scene.parent / "story.html").read_text()


def test_the_steps_come_in_order_with_pictures_and_costs(scene):
    page = told(scene)
    headings = re.findall(r"<h2 id=.step.*?>\d+\. (.*?)</h2>", page)
    assert len(headings) == 10 and headings[::9] == ["Recording", "Questions"]
    assert "700 Gaussians" in page and "2 views are outliers" in page and "4 of 5 frames have a pose" in page
    assert "put down at another: 2." in page
    assert page.count("data:image/webp") == 1, "one page is there"
    costs = re.findall(r"<tr><td>(\w+)</td>", page)
    assert costs == ["frames", "poses", "instances", "features", "splats", "language", "histories"]


def test_what_a_scene_lacks_is_one_line(scene):
    page = told(scene)
    for line, absent in (
        ("No key asks for a survey", True),
        ("Nothing is masked", True),
        ("no annotations", True),
        ("no instances are made", False),
        ("Nothing is tracked", False),
    ):
        assert (line in page) == absent


def test_names_and_the_scene_page_are_escaped(scene):
    page = told(scene, title="<b>bold</b>")
    assert "<b>" not in page and "&lt;b&gt;bold" in page
    assert 'srcdoc="&lt;!doctype html&gt;&lt;p title=&#34;a&#34;&gt;3 &lt; 4' in page


def test_a_missing_file_is_named(scene):
    with pytest.raises(UserError, match=r"crops.png: does not exist. Make it: "):
        run([scene / "crops.png"], scene / "story.html", "mine/scene")


@pytest.mark.parametrize("name", ["metrics.json", "survey.json"])
@pytest.mark.parametrize("text", ["{}", "[]", "{"])
def test_a_document_without_its_content_is_named(scene, name, text):
    (scene / name).write_text(text)
    with pytest.raises(UserError, match=f"{name}: "):
        told(scene)
