"""A headless Chromium with software WebGL, and tabs that record what goes wrong in them."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.viewing.browser import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WIDE, PHONE = (800, 500), (390, 844)
"""Window sizes [px] that a page must fit."""

READY = "window.egosplat?.firstPicture"
"""Whether the scene page has drawn its first picture."""

# The members are many.
ASK = """async (words) => {
  const { things, why, score, grade, rating } = await egosplat.ask(words);
  return { why, score, grade, rating, things: things?.map(({ members, ...thing }) => ({ ...thing, count: members?.length })) };
}"""
"""Asks the scene page; what a test needs of an answer."""


def patience_ms() -> int:
    """Milliseconds that a test waits for a condition: minutes, and more where other programs keep the processors busy."""
    waiting = os.getloadavg()[0] / (os.cpu_count() or 1)
    return round(120_000 * max(1.0, waiting))


@dataclass
class Tab:
    """A page in the browser, with errors of scripts and of the console, and addresses asked for, but data: and blob: ones."""

    page: "Page"
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.set_default_timeout(patience_ms())
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        self.page.on("request", lambda request: self._note(request.url))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.page, name)

    def _note(self, address: str) -> None:
        if not address.startswith(("data:", "blob:")):
            self.requests.append(address)


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """Debian's Chromium, headless; the tests are skipped where it or playwright is absent."""
    # Scope: playwright keeps an event loop in its thread, which tests of other files must not meet.
    api = pytest.importorskip("playwright.sync_api", reason="playwright is absent: pip install playwright")
    if (program := chromium()) is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    with api.sync_playwright() as playwright:
        # Chromium refuses its sandbox to root, as whom CI runs.
        given = {"args": ["--no-sandbox"], "timeout": patience_ms()}
        started = playwright.chromium.launch(executable_path=program, **given)
        yield started
        started.close()


@pytest.fixture
def open_tab(browser: "Browser") -> Iterator[Callable[..., Tab]]:
    """``open_tab(size, touch=False)``: a new tab of (width, height) pixels in a session of its own."""
    with ExitStack() as opened:

        def make(size: tuple[int, int] = WIDE, touch: bool = False) -> Tab:
            window = dict(zip(("width", "height"), size, strict=True))
            # Waiting for a condition evaluates text, which a page may forbid.
            context = browser.new_context(viewport=window, has_touch=touch, bypass_csp=True)
            opened.callback(context.close)
            return Tab(context.new_page())

        yield make
