"""Open a finished scene from its folder."""

from pathlib import Path
from typing import Any

from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.registry import SCHEMAS
from egosplat.pipeline.config import defaults
from egosplat.pipeline.scene_folder import check_scene_folder
from egosplat.query.finished_scene import Backends, Scene, scene_of
from egosplat.query.options import QueryOptions
from egosplat.query.text import encoded_of

# A scene with these can be asked; its codes name one more, features or tiles.
NEEDED = ("frames", "poses", "splats", "language")


def open_scene(
    folder: str | Path, *, backend: str = "auto", device: str = "auto", precision: str = "auto", **keys: Any
) -> Scene:
    """Open a finished scene or variant, such as ``results/adt/scene1``. Only what describes its artifacts is read.

    Args:
        backend: renderer, as the key ``query.backend``.
        device, precision: of OpenCLIP, as the keys of the section ``models``.
        keys: keys of the section ``query`` that differ from their defaults, such as ``min_score=0.6``.

    Raises:
        UserError: the folder is no finished scene, or an artifact is damaged or does not belong to the others; names the
            command that makes it. Or a key is not valid.

    >>> scene = egosplat.open_scene("results/adt/scene1")
    >>> scene.levels, len(scene.frames), scene.gaussians.count
    (['part', 'whole'], 5, 700)
    """
    folder = Path(folder)
    options = default_options().changed(**keys)
    return scene_of(open_artifacts(folder), options, Backends(backend, device, precision), folder)


def default_options() -> QueryOptions:
    """The defaults of the section ``query``."""
    keys = {name: value for name, value in defaults()["query"].items() if name != "backend"}
    return QueryOptions(**keys | {"canonical": tuple(keys["canonical"])})


def open_artifacts(folder: Path) -> list[Artifact]:
    """Open what queries of a scene or a variant read. Raises as ``open_scene``."""
    check_scene_folder(folder, NEEDED)
    *paths, features, tiles = locate(folder, *NEEDED, "features", "tiles")
    by_tiles = encoded_of(open_artifact(paths[-1], LANGUAGE)) == "tiles"
    return [open_artifact(path, SCHEMAS[path.stem]) for path in (*paths, tiles if by_tiles else features)]
