"""The story of a scene fits a phone."""

from egosplat.report.story import run
from tests.browser.conftest import PHONE
from tests.support.page_scene import put_page_scene


def test_nothing_of_the_story_sticks_out_of_a_phone(open_tab, tmp_path):
    """Links, costs and long paths stay within 390 pixels."""
    (folder := tmp_path / "scene").mkdir()
    put_page_scene(folder, origin="real")
    run(sorted(folder.iterdir()), tmp_path / "story.html", "mine/scene" * 8)
    tab = open_tab(PHONE)
    tab.page.goto((tmp_path / "story.html").as_uri())
    assert tab.page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [PHONE[0]] * 2
