"""The story of a scene: one page with each step, its picture, its cost and its alarms."""

import re
import shutil

import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.report.story import run
from tests.support.page_scene import put_histories


@pytest.fixture(scope="module")
def scene(page_scene, tmp_path_factory):
    """The files of a plain scene without annotations, survey and masks, and one of its pages."""
    folder = tmp_path_factory.mktemp("story") / "scene1"
    shutil.copytree(page_scene, folder)
    put_histories(folder)
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / "splats.png")
    (folder / "scene.html").write_text('<!doctype html><p title="a">3 < 4</p>')
    return sorted(folder.iterdir())


@pytest.fixture
def told(scene, tmp_path):
    """``told(more, title)``: the page of the scene with more files."""

    def read(*more, title="mine/scene") -> str:
        run([*scene, *more], tmp_path / "story.html", title)
        return (tmp_path / "story.html").read_text()

    return read


def test_the_steps_come_in_order_with_pictures_and_costs_and_what_is_absent_is_one_line(told):
    page = told()
    headings = re.findall(r"<h2 id=.step.*?>\d+\. (.*?)</h2>", page)
    assert len(headings) == 10 and headings[::9] == ["Recording", "Questions"]
    assert "700 Gaussians" in page and "2 views are outliers" in page and "4 of 5 frames have a pose" in page
    assert "from one place to another: 2." in page
    assert page.count("data:image/webp") == 1, "one page is there"
    costs = re.findall(r"<tr><td>(\w+)</td>", page)
    assert costs == ["frames", "poses", "instances", "features", "splats", "language", "histories"]
    told = "All keys are set, so there is no survey", "Nothing is masked", "no annotations"
    assert all(line in page for line in told)
    assert "there are no instances" not in page and "No moving object" not in page


def test_names_and_the_scene_page_are_escaped(told):
    page = told(title="<b>bold</b>")
    assert "<b>" not in page and "&lt;b&gt;bold" in page
    assert 'srcdoc="&lt;!doctype html&gt;&lt;p title=&#34;a&#34;&gt;3 &lt; 4' in page


def test_a_missing_file_is_named(told, tmp_path):
    with pytest.raises(UserError, match=r"crops.png: does not exist. Make it: "):
        told(tmp_path / "crops.png")


@pytest.mark.parametrize("name", ["metrics.json", "survey.json"])
@pytest.mark.parametrize("text", ["{}", "[]", "{"])
def test_a_document_without_its_content_is_named(told, tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError, match=f"{name}: "):
        told(tmp_path / name)
