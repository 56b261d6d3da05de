"""What a user is told in place of a traceback."""

import re

from egosplat.atomic import MAKE_ROOM, NO_ROOM
from egosplat.errors import UserError

_NO_MEMORY = re.compile(r"out of memory|allocate memory")
"""PyTorch's, on a GPU and on a processor, which are RuntimeErrors."""


def plain(error: Exception) -> str | None:
    """One or two lines of what went wrong and what to do; None of an error in the program, which deserves its traceback."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError):
        return _refused(error)
    if isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and _NO_MEMORY.search(str(error))):
        what = str(error).partition("\n")[0] or "MemoryError"
        return f"no memory left ({what}). Free some, or see docs/scale.md for what takes less"
    return None


def _refused(error: OSError) -> str | None:
    """What the operating system refused. An error without a number, or a file, is a library's own."""
    if error.errno in NO_ROOM:
        what = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        return f"{what}. {MAKE_ROOM}"
    if error.errno is None or error.filename is None:
        return None
    return f"{error.filename}: {error.strerror}. Check the path and its rights"
