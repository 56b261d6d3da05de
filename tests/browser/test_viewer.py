"""``egosplat view`` in a browser: a question colors the right Gaussians, a jump goes there, a click names what is there."""

import io
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from tests.browser.conftest import PATIENCE_MS, PHONE, WIDE, Tab
from tests.unit.conftest import couch_and_cup, halves, word_scene  # noqa: F401

if TYPE_CHECKING:
    from playwright.sync_api import Locator

pytest.importorskip("viser", reason='viser is absent: pip install "egosplat[viewer]"')

# Not imported before: without viser, the tests are skipped.
from egosplat.query.options import LANGSPLAT
from egosplat.viewer.command import Viewer, check_port, run
from egosplat.viewer.questions import open_questions
from egosplat.viewer.scene import open_scene
from egosplat.viewer.world import World

# Side of the picture around a point of the window whose mean color is read [px].
AROUND = 9


@pytest.fixture
def view(word_scene) -> Iterator[Callable[..., Viewer]]:  # noqa: F811
    """``view(folders=1)``: a viewer of scenes whose left half is a couch and whose right half is a cup."""
    opened = []

    def make(*changes: Callable) -> Viewer:
        folder = word_scene()
        for change in changes:
            change(folder)

        def load(viewed):
            return open_questions(viewed, LANGSPLAT, device="cpu", precision="auto", cache=None)

        opened.append(Viewer([World(open_scene(folder, "auto"))], load, "127.0.0.1", 0))
        return opened[-1]

    yield make
    for viewer in opened:
        viewer.close()


def go(tab: Tab, viewer: Viewer) -> None:
    """Open the viewer and wait until questions can be asked."""
    tab.page.goto(viewer.address)
    says(tab, "Type what you look for")


def says(tab: Tab, text: str) -> None:
    """Wait until the page shows a text."""
    tab.page.wait_for_function(
        "text => document.body.innerText.includes(text)", arg=text, timeout=PATIENCE_MS
    )


def query_field(tab: Tab) -> "Locator":
    # The page's first text field is hidden: the address of the server.
    return tab.page.locator(
        "xpath=//*[normalize-space(text())='Query']/following::input[not(@type='hidden')][1]"
    )


def ask(tab: Tab, phrase: str) -> None:
    query_field(tab).fill(phrase)


def color(tab: Tab, right: float, down: float) -> np.ndarray:
    """(3,) mean color around a point of the canvas, given in shares of its size."""
    canvas = tab.page.locator("canvas").first
    image = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB"), np.float64)
    row, column = round(down * image.shape[0]), round(right * image.shape[1])
    half = AROUND // 2
    return image[row - half : row + half + 1, column - half : column + half + 1].mean(axis=(0, 1))


def saturation(tab: Tab, right: float, down: float) -> float:
    """Range of the channels at a point: heat is colorful, everything else in this scene is grey."""
    return float(np.ptp(color(tab, right, down)))


def wait_until(tab: Tab, holds: Callable[[], bool]) -> bool:
    """Look at the page until something holds."""
    for _ in range(PATIENCE_MS // 250):
        if holds():
            return True
        tab.page.wait_for_timeout(250)
    return False


@pytest.mark.parametrize("size, down", [(WIDE, 0.7), (PHONE, 0.35)])
def test_the_viewer_opens_and_asks_nothing_of_the_network(view, open_tab, size, down):
    """At both window sizes: no error in the console, no request but to the viewer, a picture of the grey wall."""
    tab, viewer = open_tab(size), view()
    go(tab, viewer)
    assert wait_until(tab, lambda: 80 < color(tab, 0.4, down).mean() < 160)
    assert tab.errors == []
    assert all(one.startswith((viewer.address, viewer.address.replace("http", "ws"))) for one in tab.requests)


def test_a_question_colors_the_right_half_and_a_click_names_it(view, open_tab):
    """Asked for the cup, its half of the wall is hot and the couch's is not; a click on each says what it is."""
    tab = open_tab()
    go(tab, view())
    ask(tab, "cup")
    says(tab, "score")
    # The middle of the wall is in the middle of the canvas; a notice of viser's covers the upper left.
    assert wait_until(tab, lambda: saturation(tab, 0.65, 0.7) > 60)
    assert saturation(tab, 0.35, 0.7) < 25
    box = tab.page.locator("canvas").first.bounding_box()
    for right, word in ((0.35, "couch"), (0.65, "cup")):
        tab.page.mouse.click(box["x"] + right * box["width"], box["y"] + 0.7 * box["height"])
        says(tab, f"whole: {word}")
    assert tab.errors == []


def test_the_first_photograph_is_there_before_the_slider_moves(view, open_tab):
    tab = open_tab()
    go(tab, view())
    tab.page.get_by_role("tab", name="Frames").click()
    # Before a photograph is there, viser shows a picture of 2 x 2 pixels.
    shown = "[...document.images].some(image => image.src.startsWith('blob:') && image.naturalWidth > 2)"
    tab.page.wait_for_function(shown, timeout=PATIENCE_MS)


def test_a_jump_puts_the_answer_into_the_middle(view, open_tab):
    """The cup is beside the middle at first; after the jump the middle of the picture is the cup."""
    tab = open_tab()
    go(tab, view())
    ask(tab, "cup")
    says(tab, "score")
    assert wait_until(tab, lambda: saturation(tab, 0.65, 0.7) > 60) and saturation(tab, 0.4, 0.7) < 25
    tab.page.get_by_text("Jump to the answer").click()
    assert wait_until(tab, lambda: saturation(tab, 0.46, 0.7) > 60 and saturation(tab, 0.54, 0.7) > 60)


def test_an_answer_outside_of_the_view_is_told_and_the_jump_sets_the_frame(view, open_tab):
    """Seen from behind, the cup is out of view; the slider then stands at the frame that shows it best."""
    tab, viewer = open_tab(), view()
    go(tab, viewer)
    (session,) = viewer._sessions.values()
    session.look(np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, -2.0]))
    ask(tab, "cup")
    says(tab, "outside of the view")
    frame = session._panel.frames.frame
    frame.value = (
        3 if session._found() and session._world.questions.best_frame(session._found()[0]) != 3 else 2
    )
    tab.page.get_by_text("Jump to the answer").click()
    best = session._world.questions.best_frame(session._found()[0])
    assert wait_until(tab, lambda: frame.value == best)
    assert wait_until(tab, lambda: saturation(tab, 0.46, 0.7) > 60 and saturation(tab, 0.54, 0.7) > 60)


def test_what_is_not_there_and_what_is_no_question(view, open_tab):
    """An untaught word, markup and 10,000 letters are answered in words; nothing of them becomes part of the page."""
    tab = open_tab()
    go(tab, view())
    ask(tab, "spaceship")
    says(tab, "not found")
    ask(tab, "<img src=x onerror=alert(1)> {1+1}")
    says(tab, "<img src=x")
    ask(tab, "cup " * 2500)
    says(tab, "shorten it")
    assert not tab.page.locator("img[src=x]").count() and tab.errors == []


def test_two_windows_have_a_question_each(view, open_tab):
    """What one window asks does not show in the other one."""
    viewer, one, other = view(), open_tab(), open_tab()
    go(one, viewer), go(other, viewer)
    ask(one, "cup")
    says(one, "score")
    assert "score" not in other.page.evaluate("document.body.innerText")
    ask(other, "couch")
    says(other, "score")
    assert query_field(one).input_value() == "cup"


def test_a_scene_without_language_is_shown_and_says_so(view, open_tab):
    """Without language.zarr there is a picture, and the reason why nothing can be asked."""
    tab = open_tab()
    viewer = view(lambda folder: (folder / "language.zarr").rename(folder / "away.zarr"))
    tab.page.goto(viewer.address)
    says(tab, "language.zarr: does not exist")
    assert query_field(tab).is_disabled()
    assert wait_until(tab, lambda: 80 < color(tab, 0.4, 0.7).mean() < 160)


def test_a_port_in_use_gives_one_line(word_scene):  # noqa: F811
    """viser would silently take the next port; the command names the one that is taken."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"--port {port}"):
            check_port("127.0.0.1", port)
        with pytest.raises(UserError, match=f"--port {port}"):
            run(
                [word_scene()],
                LANGSPLAT,
                host="127.0.0.1",
                port=port,
                backend="cpu",
                device="cpu",
                precision="auto",
            )


def test_ctrl_c_ends_the_command(word_scene):  # noqa: F811
    """The command tells its address, ends at once with status 0, and leaves no traceback."""
    # A background job of a shell ignores SIGINT, and its children inherit that.
    hears = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{hears}; from egosplat.cli import main; main()"
    words = [sys.executable, "-c", program, "view", str(word_scene()), "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as command:
        try:
            told = command.stderr.readline()
            assert "http://127.0.0.1:" in told and "Ctrl-C" in told, told
            command.send_signal(signal.SIGINT)
            out, rest = command.communicate(timeout=PATIENCE_MS / 1000)
        finally:
            command.kill()
    assert (command.returncode, out) == (0, "") and "ended" in rest and "Traceback" not in rest
