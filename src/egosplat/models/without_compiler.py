"""Import libraries of models without torch's compiler, whose import takes 2.3 to 2.8 CPU-seconds (torch 2.15, timm 1.0).

Without transformers, too, which open_clip imports where it finds it and egosplat never uses.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

import torch

_UTILS = "torch._dynamo.utils"
_HIDDEN = "transformers"


class _StandIn(ModuleType):
    """What torchvision asks of the compiler: whether it may compile RoI pooling, which nothing here uses."""

    is_compile_supported = staticmethod(lambda device: False)

    def __getattr__(self, name: str) -> Any:
        """Import the compiler after all, for something else of it; not for ``__file__``, which ``inspect`` asks of all."""
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(_UTILS) is self:
            del sys.modules[_UTILS]
        return getattr(import_module(_UTILS), name)


@contextmanager
def without_compiler() -> Iterator[None]:
    """Make imports inside the context leave torch's compiler and transformers alone, unless they are imported already.

    Functions that a library excludes from compilation while it is imported are not excluded. Nothing here compiles any.
    """
    if "torch._dynamo" in sys.modules:
        yield
        return
    stand_in, disable = _StandIn(_UTILS), torch.compiler.disable
    sys.modules[_UTILS], torch.compiler.disable = stand_in, _unchanged
    # None makes an import fail as that of a package that is not installed.
    sys.modules.setdefault(_HIDDEN, None)  # type: ignore[arg-type]
    try:
        yield
    finally:
        torch.compiler.disable = disable
        if sys.modules.get(_HIDDEN) is None:
            sys.modules.pop(_HIDDEN, None)
        if sys.modules.get(_UTILS) is stand_in:
            del sys.modules[_UTILS]


def _unchanged(fn: Callable | None = None, *_: Any, **__: Any) -> Callable:
    """A decorator with or without arguments that changes nothing."""
    return (lambda function: function) if fn is None else fn
