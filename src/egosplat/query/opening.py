"""Open a finished scene from its folder."""

from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import LANGUAGE, SCHEMAS
from egosplat.pipeline.scene_folder import ASKED, check_scene_folder
from egosplat.query.finished_scene import Scene, scene_of
from egosplat.query.options import AskingOptions, suit_options
from egosplat.query.text import encoded_of


def open_scene(folder: str | Path, options: AskingOptions | None = None, **keys: Any) -> Scene:
    """Open a finished scene or variant, such as ``results/adt/scene1``. Only what describes its artifacts is read.

    Args:
        options: how queries are answered; None for the defaults, which follow the model.
        keys: keys of the section ``query``, ``backend``, ``device`` or ``precision`` that differ, such as ``min_score=0.6``.

    Raises:
        UserError: the folder is no finished scene, or an artifact is damaged or does not belong to the others; names the
            command that makes it. Or a key is not valid.

    >>> scene = egosplat.open_scene("results/adt/scene1")
    >>> scene.levels, len(scene.frames), scene.gaussians.count
    (['part', 'whole'], 5, 700)
    """
    folder = Path(folder)
    artifacts = open_artifacts(folder)
    clip_model = artifacts[-1].facts["clip"]["model"]
    return scene_of(artifacts, suit_options(options or AskingOptions(), clip_model, **keys), folder)


def open_artifacts(folder: Path) -> list[Artifact]:
    """Open what queries of a scene or a variant read, what OpenCLIP encoded at last. Raises as ``open_scene``."""
    check_scene_folder(folder, ASKED)
    *paths, features, tiles = locate(folder, *ASKED, "features", "tiles")
    by_tiles = encoded_of(open_artifact(paths[-1], LANGUAGE)) == "tiles"
    return [open_artifact(path, SCHEMAS[path.stem]) for path in (*paths, tiles if by_tiles else features)]
