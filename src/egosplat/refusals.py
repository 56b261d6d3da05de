"""What the operating system refuses: no fault of a file that was being read, and gone when it is asked again elsewhere."""

import contextlib
import errno
import re
from collections.abc import Callable, Iterator

from egosplat.errors import UserError

_NO_MEMORY = re.compile(
    r"out of memory|allocate memory|could not create a primitive$|failed to map segment|can't start new thread"
)
"""PyTorch's, on a GPU and on a processor; safetensors'; oneDNN's; the loader's of libraries; Python's of threads, whose
stacks are memory."""

_REFUSED = {
    *(errno.EACCES, errno.EPERM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN),
    *(errno.EIO, errno.ESTALE, errno.ETIMEDOUT),
}
"""Rights; open files and processes; a file system that does not answer."""


def lacks_memory(error: Exception) -> bool:
    """Whether an error is of memory that was refused."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    return isinstance(error, (RuntimeError, ImportError, OSError)) and bool(_NO_MEMORY.search(str(error)))


def refused(error: Exception) -> bool:
    """Whether an error says nothing of what a file holds: of memory, rights, open files or the file system."""
    return lacks_memory(error) or (isinstance(error, OSError) and error.errno in _REFUSED)


@contextlib.contextmanager
def told_as(
    tell: Callable[[Exception], UserError], kinds: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Tell what a library raises in the block as ``tell`` has it; what the system refuses passes as it is.

    Args:
        tell: the error to raise in its place.
        kinds: of errors that are told so; all by default, for libraries that raise many.
    """
    try:
        yield
    except kinds as error:
        if refused(error):
            raise
        raise tell(error) from error
