"""The browser of the tests itself; the server of ``egosplat view``; the story of a scene on a phone."""

import re
import shutil
import signal
import subprocess
import sys
import time
from http.client import HTTPConnection
from threading import Event

import pytest

from egosplat.query.finished_scene import open_scene
from egosplat.query.like import read_names
from egosplat.report.story import run
from egosplat.viewing.command import open_page
from egosplat.viewing.options import PageOptions
from tests.browser.conftest import ASK, PHONE, READY, WIDE, patience_ms
from tests.support.page_scene import put_looks, put_page_scene


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_browser_has_webgl_2(open_tab, size):
    page = open_tab(size).page
    assert page.evaluate("!!document.createElement('canvas').getContext('webgl2')")
    assert page.evaluate("[innerWidth, innerHeight]") == list(size)


def test_a_tab_records_errors_and_requests(open_tab):
    """A test that finds no error and no request proves something only if a tab would record them."""
    tab = open_tab()
    tab.set_content("<script>console.error('wrong'); fetch('http://127.0.0.1:9/')</script>")
    tab.evaluate("() => { setTimeout(() => { throw new Error('thrown') }) }")
    tab.wait_for_function("true")
    assert any("wrong" in error for error in tab.errors)
    assert "http://127.0.0.1:9/" in tab.requests


def test_the_server_answers_as_python_does(page_scene, open_tab, serve):
    """HTML stays text, and nothing else is asked for."""
    page, server = open_tab(), serve(*open_page(page_scene, PageOptions(device="cpu")))
    page.goto(server.address)
    page.wait_for_function(READY)
    [cup], found = open_scene(page_scene, device="cpu").ask("wooden cup"), page.evaluate(ASK, "wooden cup")
    assert found["rating"] == pytest.approx(cup.rating) and len(found["things"]) == len(cup.things) == 1
    assert found["things"][0]["center"] == pytest.approx(cup.things[0].center.tolist())
    assert '"<img>" was' not in page.evaluate(ASK, "<img src=x>")["why"]
    page.evaluate(ASK, "zeppelin & cup")
    page.wait_for_url(re.compile("#ask=zeppelin.*&view="))
    (other := open_tab()).goto(page.url)
    other.locator("#answer:not([aria-busy])", has_text="cup: found").wait_for()
    assert re.search("zeppelin: .* never taught .*\ncup: found", page.inner_text("#answer"))
    assert "shorten it" in page.evaluate(ASK, "cup " * 400)["why"]
    assert all(one.startswith(server.address) for one in page.requests) and page.errors == []
    server.shutdown()
    server.server_close()
    assert "egosplat view" in page.evaluate(ASK, "red cup")["why"]


def test_nothing_of_the_last_answer_stays_while_the_next_is_awaited(page_scene, open_tab, serve):
    page, let, (text, answer) = open_tab(), Event(), open_page(page_scene, PageOptions(device="cpu"))
    page.goto(serve(text, lambda **asked: let.wait(patience_ms() / 1000) and answer(**asked)).address)
    page.wait_for_function(READY)
    let.set()
    page.evaluate(ASK, "cup")
    shown = [page.locator(name) for name in ("#things button", "#mark span", "#heat")]
    assert [one.wait_for() for one in shown] and not let.clear()
    page.fill("#words", "where is my couch?")
    page.press("#words", "Enter")
    page.locator("#answer[aria-busy=true]", has_text="where is my couch?").wait_for()
    assert [one.wait_for(state="hidden") for one in shown] and not let.set()
    page.locator("#answer:not([aria-busy])", has_text="(read as: couch): found").wait_for()


def test_what_is_clicked_gets_a_name_and_finds_what_looks_like_it(tmp_path, page_scene, open_tab, serve):
    page, folder = open_tab(), shutil.copytree(page_scene, tmp_path / "scene")
    put_looks(folder)
    page.goto(serve(*open_page(folder, PageOptions(device="cpu"))).address)
    page.wait_for_function(READY)
    page.evaluate("egosplat.setView([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], 300)")
    page.evaluate("egosplat.show({ level: 0 })")
    page.mouse.click(*page.evaluate("egosplat.project([0.9, 0.3, 2])"))
    page.fill("#place input", " My  Mug")
    page.click("text=Name it")
    page.locator("#answer", has_text='"My Mug": found').wait_for()
    assert "Go there: found, similarity 1.00" in page.inner_text("#things button")
    assert [*read_names(folder)] == ["my mug"]
    assert page.evaluate("egosplat.ask('my mug').then(({ things }) => things[0].center[0])") > 0.5
    assert page.evaluate("egosplat.showing.relevancy[0].filter((one) => one > 0.9).length") > 100
    page.click("text=More like this")
    page.locator("#answer:not([aria-busy])", has_text='"more like this": best guess').wait_for()
    assert page.errors == []


@pytest.mark.parametrize("busy", [False, True])
def test_ctrl_c_ends_the_command_with_status_0(page_scene, busy):
    # A background job of a shell ignores SIGINT, and its children inherit that.
    hears = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{hears}; from egosplat.cli import main; main()"
    words = [sys.executable, "-c", program, "view", str(page_scene), "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as command:
        try:
            told = command.stderr.readline()
            assert "http://127.0.0.1:" in told and "Ctrl-C" in told, told
            if busy:
                HTTPConnection(re.search("//([^/]+)/", told)[1]).request("GET", "/ask?phrase=red+cup")
                time.sleep(3.0)
            command.send_signal(signal.SIGINT)
            out, rest = command.communicate(timeout=patience_ms() / 1000)
        finally:
            command.kill()
    assert (command.returncode, out) == (0, "") and rest.endswith("ended\n") and "Traceback" not in rest


def test_nothing_of_the_story_sticks_out_of_a_phone(open_tab, tmp_path):
    (folder := tmp_path / "scene").mkdir()
    put_page_scene(folder, origin="real")
    run(sorted(folder.iterdir()), tmp_path / "story.html", "mine/scene" * 8)
    tab = open_tab(PHONE)
    tab.goto((tmp_path / "story.html").as_uri())
    assert tab.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [PHONE[0]] * 2
