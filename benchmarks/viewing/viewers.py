"""Times of the viewer: from the command to its address, to the panel, to the first and to further answers."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from benchmarks.common import markdown
from benchmarks.viewing.browser import open_tab
from egosplat.errors import UserError

_QUERY = "xpath=//*[normalize-space(text())='Query']/following::input[not(@type='hidden')][1]"
_SHOWS = "text => document.body.innerText.includes(text)"


def table(scene: Path, words: Sequence[str]) -> str:
    """Open a scene in the viewer twice, the second time with what the first one kept; returns the table in Markdown."""
    rows = []
    with TemporaryDirectory() as cache:
        for opening in ("first", "later"):
            found = measured(scene, Path(cache), words)
            rows += [[f"{opening} opening: {what}", *times] for what, *times in found]
    return markdown(["", "by the clock [s]", "processor time [s]"], rows)


def measured(scene: Path, cache: Path, words: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """What was done, and its time by the clock and on processors."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "egosplat.cli", "view", str(scene), "--port", "0"]
    # The user's own cache stays as it is.
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    viewer = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    process = psutil.Process(viewer.pid)

    def since(before: float) -> tuple[str, str]:
        used = process.cpu_times()
        return f"{time.perf_counter() - begun:.1f}", f"{used.user + used.system - before:.2f}"

    try:
        address = _address(viewer)
        yield "from the command to its address", *since(0.0)
        with open_tab() as page:
            begun = time.perf_counter()
            page.goto(address)
            page.wait_for_selector(_QUERY)
            yield "from the address to the panel", f"{time.perf_counter() - begun:.1f}", ""
            page.wait_for_function(_SHOWS, arg="Type what you look for")
            yield "from the address to questions", *since(0.0)
            for word in words:
                used = process.cpu_times()
                begun = time.perf_counter()
                page.locator(_QUERY).fill(word)
                page.wait_for_function(
                    "word => new RegExp('(^|\\\\W)' + word + '\\\\W.*(found|\\\\d\\\\.\\\\d\\\\d)').test(document.body.innerText)",
                    arg=word,
                    # By the clock: the drawing of a browser without a GPU may wait for seconds.
                    polling=50,
                )
                yield f'an answer: "{word}"', *since(used.user + used.system)
    finally:
        viewer.send_signal(signal.SIGINT)
        viewer.wait()


def _address(viewer: "subprocess.Popen[str]") -> str:
    assert viewer.stderr is not None
    for line in viewer.stderr:
        if found := re.search(r"http://\S+", line):
            return found[0]
    raise UserError("the viewer ended before it had an address")
