"""``egosplat view``: the scene page from a server that answers phrases for it."""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

from egosplat.viewing.command import open_page
from egosplat.viewing.options import PageOptions
from egosplat.viewing.server import PageServer
from tests.browser.conftest import ASK, READY, patience_ms
from tests.support.page_scene import put_page_scene, write_page


@pytest.fixture
def serve() -> Iterator[Callable[..., PageServer]]:
    """``serve(page, answer)``: a server that runs until the test ends."""
    running = []

    def make(page, answer) -> PageServer:
        server = PageServer("127.0.0.1", 0)
        server.offer(page, answer)
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        running.append(server)
        return server

    yield make
    for server in running:
        server.shutdown()
        server.server_close()


def test_the_server_answers_what_the_page_cannot(tmp_path, open_tab, serve, monkeypatch):
    """Without a text tower in the page, the server's answers are those of a page with one; HTML stays text."""
    put_page_scene(tmp_path)
    tab = open_tab()
    tab.page.goto(write_page(tmp_path).as_uri())
    tab.page.wait_for_function(READY)
    expected = tab.page.evaluate(ASK, "wooden cup")
    (tmp_path / "scene.html").unlink()
    monkeypatch.setattr("egosplat.viewing.words.MOST_NUMBERS", 1000)
    server = serve(*open_page(tmp_path, PageOptions(device="cpu")))
    tab.page.goto(server.address)
    tab.page.wait_for_function(READY)
    assert tab.page.evaluate("egosplat.tower") is None
    found = tab.page.evaluate(ASK, "wooden cup")
    assert found["score"] == pytest.approx(expected["score"], abs=0.02) and len(found["things"]) == 1
    assert found["things"][0]["center"] == pytest.approx(expected["things"][0]["center"], abs=0.05)
    assert '"<img>" was' not in tab.page.evaluate(ASK, "<img src=x>")["why"]
    assert '"zeppelin"' in tab.page.evaluate(ASK, "zeppelin & cup")["why"]
    assert "shorten it" in tab.page.evaluate(ASK, "cup " * 400)["why"]
    assert all(one.startswith(("file:", server.address)) for one in tab.requests) and tab.errors == []
    server.shutdown()
    server.server_close()
    assert "egosplat view" in tab.page.evaluate(ASK, "red cup")["why"]


def test_ctrl_c_ends_the_command(tmp_path):
    """The command tells its address, ends with status 0, and leaves no traceback."""
    put_page_scene(tmp_path)
    write_page(tmp_path)
    # A background job of a shell ignores SIGINT, and its children inherit that.
    hears = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{hears}; from egosplat.cli import main; main()"
    words = [sys.executable, "-c", program, "view", str(tmp_path), "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as command:
        try:
            told = command.stderr.readline()
            assert "http://127.0.0.1:" in told and "Ctrl-C" in told, told
            command.send_signal(signal.SIGINT)
            out, rest = command.communicate(timeout=patience_ms() / 1000)
        finally:
            command.kill()
    assert (command.returncode, out, rest.count("\n")) == (0, "", 1) and "ended" in rest
