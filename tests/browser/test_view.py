"""The browser of the tests itself; the server of ``egosplat view``; the story of a scene on a phone."""

import shutil
import signal
import subprocess
import sys

import pytest

from egosplat.report.story import run
from egosplat.viewing.command import open_page
from egosplat.viewing.options import PageOptions
from tests.browser.conftest import ASK, PHONE, READY, WIDE, patience_ms
from tests.support.page_scene import put_page_scene


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_browser_has_webgl_2(open_tab, size):
    page = open_tab(size).page
    assert page.evaluate("!!document.createElement('canvas').getContext('webgl2')")
    assert page.evaluate("[innerWidth, innerHeight]") == list(size)


def test_a_tab_records_errors_and_requests(open_tab):
    """A test that finds no error and no request proves something only if a tab would record them."""
    tab = open_tab()
    tab.page.set_content("<script>console.error('wrong'); fetch('http://127.0.0.1:9/')</script>")
    tab.page.evaluate("() => { setTimeout(() => { throw new Error('thrown') }) }")
    tab.page.wait_for_function("true")
    assert any("wrong" in error for error in tab.errors)
    assert "http://127.0.0.1:9/" in tab.requests


def test_the_server_answers_what_the_page_cannot(tmp_path, page_scene, open_tab, serve, monkeypatch):
    """Without a text tower in the page, the server's answers are those of a page with one; HTML stays text."""
    tab = open_tab()
    page = tab.page
    page.goto((page_scene / "scene.html").as_uri())
    page.wait_for_function(READY)
    expected = page.evaluate(ASK, "wooden cup")
    folder = shutil.copytree(page_scene, tmp_path / "scene", ignore=lambda *_: ["scene.html"])
    monkeypatch.setattr("egosplat.viewing.words.MOST_NUMBERS", 1000)
    server = serve(*open_page(folder, PageOptions(device="cpu")))
    page.goto(server.address)
    page.wait_for_function(READY)
    assert page.evaluate("egosplat.tower") is None
    found = page.evaluate(ASK, "wooden cup")
    assert found["score"] == pytest.approx(expected["score"], abs=0.02) and len(found["things"]) == 1
    assert found["things"][0]["center"] == pytest.approx(expected["things"][0]["center"], abs=0.05)
    assert '"<img>" was' not in page.evaluate(ASK, "<img src=x>")["why"]
    assert '"zeppelin"' in page.evaluate("egosplat.ask('zeppelin & cup').then(({ read }) => read)")
    assert "shorten it" in page.evaluate(ASK, "cup " * 400)["why"]
    assert all(one.startswith(("file:", server.address)) for one in tab.requests) and tab.errors == []
    server.shutdown()
    server.server_close()
    assert "egosplat view" in page.evaluate(ASK, "red cup")["why"]


def test_ctrl_c_ends_the_command_with_status_0(page_scene):
    # A background job of a shell ignores SIGINT, and its children inherit that.
    hears = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{hears}; from egosplat.cli import main; main()"
    words = [sys.executable, "-c", program, "view", str(page_scene), "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as command:
        try:
            told = command.stderr.readline()
            assert "http://127.0.0.1:" in told and "Ctrl-C" in told, told
            command.send_signal(signal.SIGINT)
            out, rest = command.communicate(timeout=patience_ms() / 1000)
        finally:
            command.kill()
    assert (command.returncode, out, rest.count("\n")) == (0, "", 1) and "ended" in rest


def test_nothing_of_the_story_sticks_out_of_a_phone(open_tab, tmp_path):
    (folder := tmp_path / "scene").mkdir()
    put_page_scene(folder, origin="real")
    run(sorted(folder.iterdir()), tmp_path / "story.html", "mine/scene" * 8)
    tab = open_tab(PHONE)
    tab.page.goto((tmp_path / "story.html").as_uri())
    assert tab.page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [PHONE[0]] * 2
