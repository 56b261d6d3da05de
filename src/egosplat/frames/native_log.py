"""Capture the log of C++ libraries (projectaria-tools, FFmpeg inside OpenCV). They log every step, and
occasionally a real problem, directly to the process's standard output and error."""

import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator

# Colors, and FFmpeg's address of a part of itself: [av1 @ 0x562b62ae5580].
_NOISE = re.compile(r"\x1b\[[0-9;]*m| @ 0x[0-9a-f]+")
_CHATTER = re.compile(
    r"\[(INFO|DEBUG)\]"
    # Logged for every segmentation file of ADT; harmless.
    r"|not found in Aria Device Model|does not contain calib_json|Tag 'metadata' was not found"
    r"|Invalid device version|No metadata file provided|Unknown dataset version"
)


@contextlib.contextmanager
def captured_log() -> Iterator[list[str]]:
    """Capture the messages that C++ code logs inside the block, without chatter; they appear nowhere else.
    The list is filled when the block ends. Log the messages or put them into an error."""
    # C++ writes to file descriptors 1 and 2, so redirecting sys.stdout and sys.stderr would not catch it.
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
            text = sink.read().decode(errors="replace")
            lines = [_NOISE.sub("", line).strip() for line in text.splitlines()]
            messages += [line for line in lines if line and not _CHATTER.search(line)]
