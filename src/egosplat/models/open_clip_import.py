"""Import OpenCLIP without what takes longer to import and nothing here needs: torch's compiler, and timm."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import reload

from egosplat.models.without_compiler import without_compiler


@contextmanager
def _without_timm() -> Iterator[None]:
    """Make imports of timm fail inside the context, unless it is imported already. OpenCLIP expects such a failure."""
    if "timm" in sys.modules:
        yield
        return
    sys.modules["timm"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules["timm"]


with without_compiler(), _without_timm():
    import open_clip

__all__ = ["allow_timm", "open_clip"]


def allow_timm() -> None:
    """Let OpenCLIP build vision models of timm from now on."""
    from open_clip import timm_model

    if timm_model.timm is None:
        # A reload keeps the module's namespace, so functions of the classes in use find the library too.
        with without_compiler():
            reload(timm_model)
