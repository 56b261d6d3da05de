"""Show a finished scene in the browser until the user ends it (``egosplat view``), or write its page (``egosplat page``)."""

import os
import threading
from functools import cache
from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import locate, open_histories
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError, user_message
from egosplat.pipeline.home import NAMES, check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.query.options import AskingOptions
from egosplat.viewing.html import Facts, facts_of, record_of
from egosplat.viewing.options import PageOptions, ScenePageOptions
from egosplat.viewing.server import Ask, PageServer

_PAGE = STAGES["scene_page"]


def run(folder: Path, options: PageOptions, host: str, port: int) -> None:
    """Serve the page of a scene until Ctrl-C; phrases that it does not know are asked here (UserError: an artifact is missing, damaged or
    does not belong to the others; its OpenCLIP is missing; or the port is in use)."""
    check_scene_folder(folder, _PAGE.inputs)
    # Before the page is made, which takes seconds.
    with PageServer(host, port) as server:
        show(server, folder, options)


def show(server: PageServer, folder: Path, options: PageOptions) -> None:
    """Serve the page of a scene as ``run`` does."""
    server.offer(*open_page(folder, options))
    try:
        log(f"{server.address} shows {folder}. Ctrl-C ends it.")
        server.serve_forever()
    except KeyboardInterrupt:
        log("ended")
        # An end that waits for no thread, and finds none that still computes: else the process aborts.
        os._exit(0)


def write_page(folder: Path, output: Path, options: AskingOptions, title: str | None = None) -> None:
    """Write the scene page of a finished scene; its title is ``dataset/scene`` unless given. Raises as the stage."""
    from egosplat.query.finished_scene import scene_of
    from egosplat.viewing import stage

    artifacts = _open_inputs(folder)
    keys = page_options(artifacts["features"], options)
    scene = scene_of(artifacts.values(), keys, folder)
    stage.write_page(scene, output, keys, title or title_of(folder))


def _open_inputs(folder: Path) -> dict[str, Artifact]:
    """Open what a scene's page is made of: the inputs of its stage, and histories.zarr if it is there."""
    paths = locate(folder, *_PAGE.inputs)
    artifacts = {path.stem: open_artifact(path, SCHEMAS[path.stem]) for path in paths}
    histories = open_histories(folder, artifacts["splats"])
    return artifacts if histories is None else artifacts | {"histories": histories}


def page_options(features: Artifact, options: AskingOptions) -> ScenePageOptions:
    """The options of a page: what is not set follows the models that made the features."""
    clip = features.facts["clip"]
    given = {name: getattr(options, name) for name in options.model_fields_set}
    files = {"clip_model": clip["model"], "clip_checkpoint": clip["checkpoint"]}
    return ScenePageOptions(**files | given).suit(clip["model"])


def open_page(folder: Path, options: PageOptions) -> tuple[str, Ask]:
    """The page of a scene, and what answers phrases that the page does not know; errors as in ``run``.

    The page in the folder is taken if it was made from the same artifacts with the same options."""
    artifacts = _open_inputs(folder)
    keys = page_options(artifacts["features"], options)

    @cache
    def scene() -> Any:
        # Here, because PyTorch takes seconds to import, which a page that is there does not need.
        from egosplat.query.finished_scene import scene_of

        return scene_of(artifacts.values(), keys, folder)

    path = folder / _PAGE.output
    page = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    facts = facts_of(page)
    if not record_of(artifacts.values(), keys, folder).items() <= facts.items():
        from egosplat.viewing.stage import make_page

        log(f"{folder}: making the page")
        page, facts = make_page(scene(), keys, title_of(folder))
    if not facts["tower"]:
        # Nothing else encodes words: an OpenCLIP that is missing is told at once.
        scene().clip  # noqa: B018

    known = dict(zip(facts["words"], facts["answers"], strict=True))
    lock = threading.Lock()

    def ask(**asked: str) -> Facts:
        if not asked:  # by a growing page, which then knows that this one is there
            return {}
        if (word := asked.get("phrase", "").lower()) in known and not (folder / NAMES).is_file():
            return {"answers": [known[word]]}
        from egosplat.viewing.words import ask_for_page

        with lock:
            try:
                return ask_for_page(scene(), **asked)
            except (UserError, OSError) as error:  # as of a name in a scene that may not be written
                return {"why": user_message(error) or str(error)}

    return page, ask
