"""What libraries written in C++ (projectaria-tools, FFmpeg inside OpenCV) have to say.

They write every step, and now and then a real problem, straight to the process's standard output and
error. ``captured_log`` keeps what matters of it.
"""

import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from egosplat.progress import log

_COLOUR_CODE = re.compile(r"\x1b\[[0-9;]*m")
_CHATTER = re.compile(
    r"\[(INFO|DEBUG)\]"
    # True of every segmentation file of the dataset, and of no consequence for it.
    r"|not found in Aria Device Model|does not contain calib_json|Tag 'metadata' was not found"
    r"|Invalid device version|No metadata file provided|Unknown dataset version"
)

_DAMAGE = re.compile(r"\[ERROR\]|corrupt|premature end|unsupported marker|decompression error", re.IGNORECASE)


@contextlib.contextmanager
def captured_log() -> Iterator[list[str]]:
    """Collect what C++ code logs inside the block, chatter left out; the list is filled when the block ends.

    Works on the process's file descriptors 1 and 2, which is where C++ writes. Hand the messages to
    ``report`` or put them into an error: they are shown nowhere else.
    """
    messages: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as sink:
        saved = [(number, os.dup(number)) for number in (1, 2)]
        for number, _ in saved:
            os.dup2(sink.fileno(), number)
        try:
            yield messages
        finally:
            for number, copy in saved:
                os.dup2(copy, number)
                os.close(copy)
            sink.seek(0)
            messages += _worth_telling(sink.read().decode(errors="replace"))


def _worth_telling(text: str) -> list[str]:
    lines = (_COLOUR_CODE.sub("", line).strip() for line in text.splitlines())
    return [line for line in lines if line and not _CHATTER.search(line)]


def damage(messages: list[str]) -> str | None:
    """The first message that says that data is damaged: libraries go on then with whatever came out."""
    return next((message for message in messages if _DAMAGE.search(message)), None)


def report(messages: list[str], path: Path) -> None:
    """Show what the library logged about ``path``, on standard error, each message once."""
    for message in dict.fromkeys(messages):
        log(f"{path}: {message}")
