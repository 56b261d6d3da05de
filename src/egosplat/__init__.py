"""egosplat: ask questions in words of a 3D scene filmed from someone's head (docs/python.md)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from egosplat.errors import UserError
    from egosplat.query.answers import Answer, FoundThing, FoundView
    from egosplat.query.finished_scene import Scene
    from egosplat.query.opening import open_scene
    from egosplat.rasterize.api import rasterization

__version__ = "0.1.0"

# The module of each public name. It is imported on first use, so that ``import egosplat`` takes no time.
_MODULES = {
    "Answer": "egosplat.query.answers",
    "FoundThing": "egosplat.query.answers",
    "FoundView": "egosplat.query.answers",
    "Scene": "egosplat.query.finished_scene",
    "UserError": "egosplat.errors",
    "open_scene": "egosplat.query.opening",
    "rasterization": "egosplat.rasterize.api",
}

__all__ = [
    "Answer",
    "FoundThing",
    "FoundView",
    "Scene",
    "UserError",
    "__version__",
    "open_scene",
    "rasterization",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'egosplat' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
