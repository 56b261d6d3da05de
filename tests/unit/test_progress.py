"""Progress is a bar on a terminal and plain lines in a log."""

import contextlib
import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest

from egosplat import progress
from egosplat.progress import track


@pytest.mark.parametrize(
    "items, line",
    [([1, 2, 3], "counting: 3/3 frames"), ([], "counting: 0/0"), ((n for n in "ab"), "counting: 2 frames")],
)
def test_items_pass_through_and_a_log_gets_a_last_line(capsys, items, line):
    passed = list(track(items, "counting"))
    assert passed == (items if isinstance(items, list) else ["a", "b"])
    assert line in capsys.readouterr().err


def test_a_log_gets_lines_with_rate_and_remaining_time(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_SECONDS_BETWEEN_LINES", 0.0)
    assert list(track(iter(range(3)), "reading", total=3, unit="picture")) == [0, 1, 2]
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("reading: 1/3 pictures, ") and "left" not in lines[0] and " left" in lines[1]
    assert lines[-1].startswith("reading: 3/3 pictures") and "\r" not in "".join(lines)


def test_a_terminal_gets_a_bar():
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))  # rows, columns
    code = "from egosplat.progress import show_log, track\nshow_log()\nlist(track(range(5), 'counting'))"
    subprocess.run([sys.executable, "-c", code], stderr=theirs, check=True)
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # the end of a terminal whose other side is closed
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    assert b"counting: 100%" in shown


def test_a_program_that_imports_the_package_decides_what_is_shown():
    """Nothing by default; its own handler gets the lines, once."""
    code = "import logging; from egosplat.progress import log, show_log, track\n"
    work = "log('quiet'); list(track([1], 'counting'))\n"
    own = "logging.basicConfig(level=logging.INFO, format='own %(name)s %(message)s')\n"
    handler = "logging.getLogger('egosplat').addHandler(logging.NullHandler()); show_log()\n"

    def said(program: str) -> str:
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        return done.stdout + done.stderr

    assert said(code + work) == ""
    assert said(code + own + work).splitlines()[0] == "own egosplat quiet"
    assert said(code + handler + work) == ""
