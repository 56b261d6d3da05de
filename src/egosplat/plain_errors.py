"""What a user is told in place of a traceback."""

import resource

from egosplat.atomic import MAKE_ROOM, NO_ROOM
from egosplat.errors import UserError
from egosplat.refusals import lacks_memory


def plain(error: Exception) -> str | None:
    """One or two lines of what went wrong and what to do; None of an error in the program, which deserves its traceback."""
    if isinstance(error, UserError):
        return str(error)
    if lacks_memory(error):
        what = str(error).partition("\n")[0] or "MemoryError"
        return f"no memory left ({what}). {_more_memory()}"
    if isinstance(error, OSError):
        return _refused(error)
    return None


def _more_memory() -> str:
    """What to do. Some schedulers limit addresses in place of memory, and libraries take many that they never fill."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return "Free some, or see docs/scale.md for what takes less"
    return f"ulimit -v allows {limit / 1e6:,.0f} MB, and PyTorch's libraries alone map up to 4,000: raise it, or set none"


def _refused(error: OSError) -> str | None:
    """What the operating system refused. An error without a number, or a file, is a library's own."""
    if error.errno in NO_ROOM:
        what = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        return f"{what}. {MAKE_ROOM}"
    if error.errno is None or error.filename is None:
        return None
    return f"{error.filename}: {error.strerror}. Check the path and its rights"
