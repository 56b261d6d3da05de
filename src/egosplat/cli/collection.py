"""Python's search for garbage, which finds hardly any among the half a million objects that libraries make."""

import atexit
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collection() -> Iterator[None]:
    """Search for no garbage inside this context, and never again among what is left of it.

    For imports, and for commands that end soon: while torch is imported, its objects are searched tens of times.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def end_without_collection() -> None:
    """Leave the objects of this process to the operating system when it ends, which takes Python longer than a query."""
    atexit.register(_leave)


def _leave() -> None:
    # Triton reports each of its objects that is not freed as a leak.
    (gc.unfreeze if "triton" in sys.modules else gc.freeze)()
