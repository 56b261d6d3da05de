"""The browser of the tests itself."""

import pytest

from tests.browser.conftest import PHONE, WIDE

_WEBGL = "!!document.createElement('canvas').getContext('webgl2')"


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_browser_has_webgl_2(open_tab, size):
    tab = open_tab(size)
    assert tab.page.evaluate(_WEBGL)
    assert tab.page.evaluate("[innerWidth, innerHeight]") == list(size)


def test_a_tab_records_errors_and_requests(open_tab):
    """A test that finds no error and no request proves something only if a tab would record them."""
    tab = open_tab()
    tab.page.set_content("<script>console.error('wrong'); fetch('http://127.0.0.1:9/')</script>")
    tab.page.evaluate("() => { setTimeout(() => { throw new Error('thrown') }) }")
    tab.page.wait_for_function("true")
    assert any("wrong" in error for error in tab.errors)
    assert "http://127.0.0.1:9/" in tab.requests
