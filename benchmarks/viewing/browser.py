"""A headless Chromium with software rendering, as on a computer without a GPU."""

import contextlib
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

from egosplat.errors import UserError

if TYPE_CHECKING:
    from playwright.sync_api import Page

SIZE = {"width": 800, "height": 500}

# Longest wait for anything on a page [ms].
PATIENCE_MS = 300_000


def chromium() -> str | None:
    """Path of the machine's Chromium; None if there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@contextlib.contextmanager
def open_tab() -> "Iterator[Page]":
    """Open an empty tab.

    Raises:
        UserError: there is no Chromium.
    """
    from playwright.sync_api import sync_playwright

    program = chromium()
    if program is None:
        raise UserError("there is no Chromium: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        # Waiting for a condition evaluates text, which the scene page forbids.
        page = browser.new_context(viewport=SIZE, bypass_csp=True).new_page()
        page.set_default_timeout(PATIENCE_MS)
        yield page
        browser.close()
