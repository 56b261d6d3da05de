"""Errors that a user can act on, errors of the operating system, and the text that the command line prints for them."""

import contextlib
import errno
import re
import resource
from collections.abc import Callable, Iterator
from numbers import Integral

# Error numbers of a full disk, an exhausted quota, and a file larger than the limit.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

# The advice for ``NO_ROOM``.
MAKE_ROOM = "Make room and start the same command again: complete results are kept"

# Advice where a module of an extra is missing.
_ADVICE = '{} is not installed; it comes with: pip install "egosplat[{}]"'.format
EXTRAS = {
    "projectaria_tools": _ADVICE(
        "projectaria-tools (ADT and synthetic apartments, Python 3.11 or 3.12)", "aria"
    ),
    "gsply": _ADVICE("gsply", "export"),
    "rerun": _ADVICE("rerun-sdk", "rerun"),
    "sklearn": _ADVICE("scikit-learn", "clusters"),
}

_NO_MEMORY = re.compile(
    r"out of memory|allocate memory|could not create a primitive$|failed to map segment|can't start new thread"
)
# In order: PyTorch on a GPU, PyTorch on a CPU, oneDNN, the library loader, and Python: a thread's stack is memory.

_SYSTEM_ERRORS = {
    *(errno.EACCES, errno.EPERM),  # rights
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN),  # open files and processes
    *(errno.EIO, errno.ESTALE, errno.ETIMEDOUT),  # a file system that does not answer
}


class UserError(Exception):
    """A mistake in the input, the configuration or the environment, described in one or two lines.

    The message names the file or key, what is wrong with it, and what to do. The command line
    prints it without a traceback and exits with status 2. Programming errors are never wrapped in it.
    Secrets of addresses are left out.
    """

    def __init__(self, message: str) -> None:
        super().__init__(without_secrets(message))


def read_whole(name: str, value: object, least: int = 0) -> int:
    """A whole number that a caller of the library gave (UserError: it is none, or smaller than ``least``)."""
    if not isinstance(value, Integral) or value < least:
        raise UserError(f"{name} is {value!r:.40}; give a whole number from {least} on")
    return int(value)


def without_secrets(text: str) -> str:
    """Leave names and passwords, and what follows a question mark, out of the addresses in a text."""
    # A path has one slash of an address.
    return re.sub(r"(:/[^\s?]*\?)[^\s'\")]+", r"\1...", re.sub(r"(:/{1,2})[^\s/@]*@", r"\1...@", text))


def is_out_of_memory(error: Exception) -> bool:
    """Whether an error means that no memory is left."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    return isinstance(error, (RuntimeError, ImportError, OSError)) and bool(_NO_MEMORY.search(str(error)))


def is_system_error(error: Exception) -> bool:
    """Whether an error comes from the system: memory, rights, open files, file system.

    It says nothing about a file's content: the same operation may succeed later, or on another machine.
    """
    return is_out_of_memory(error) or (isinstance(error, OSError) and error.errno in _SYSTEM_ERRORS)


@contextlib.contextmanager
def reraise_as(
    describe: Callable[[Exception], UserError], kinds: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Replace errors of ``kinds`` that a library raises in the block by ``describe(error)``; system errors pass unchanged."""
    try:
        yield
    except kinds as error:
        if is_system_error(error):
            raise
        raise describe(error) from error


@contextlib.contextmanager
def from_extra(module: str, needed_by: str = "") -> Iterator[None]:
    """Raise UserError where the block cannot import a module of ``EXTRAS``; it names the file that needs it."""
    try:
        yield
    except ImportError:
        raise UserError(f"{needed_by}: {EXTRAS[module]}".removeprefix(": ")) from None


def user_message(error: Exception) -> str | None:
    """The message for a user, in one or two lines; None for a programming error, which needs its traceback."""
    if isinstance(error, UserError):
        return str(error)
    if is_out_of_memory(error):
        what = str(error).partition("\n")[0] or "MemoryError"
        return f"no memory left ({what}). {_memory_advice()}"
    if isinstance(error, ModuleNotFoundError) and (module := (error.name or "").partition(".")[0]) in EXTRAS:
        return EXTRAS[module]
    if isinstance(error, OSError):
        return _os_message(error)
    return None


def _memory_advice() -> str:
    # Some schedulers limit addresses in place of memory; libraries reserve many addresses that they never fill.
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return "Free some, or see docs/running.md for what takes less"
    return f"ulimit -v allows {limit / 1e6:,.0f} MB, and PyTorch's libraries alone map up to 4,000: raise it, or set none"


def _os_message(error: OSError) -> str | None:
    # Python's tempfile, too, finds no room, and names no file.
    if error.errno in NO_ROOM or (error.strerror or "").startswith("No usable temporary directory"):
        what = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        return f"{what}. {MAKE_ROOM}"
    # An error without a number or a file comes from a library, not from the system.
    if error.errno is None or error.filename is None:
        return None
    return f"{error.filename}: {error.strerror}. Check the path and its rights"
