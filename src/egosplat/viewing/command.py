"""Show a finished scene in the browser until the user ends it (``egosplat view``), or write its page (``egosplat page``)."""

import threading
import webbrowser
from functools import cache
from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import locate, open_histories
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.pipeline.home import check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES, run_stage
from egosplat.progress import log
from egosplat.query.options import AskingOptions
from egosplat.viewing.container import Facts, unpack
from egosplat.viewing.html import data_of, record_of
from egosplat.viewing.options import PageOptions, ScenePageOptions
from egosplat.viewing.server import Ask, PageServer

_PAGE = STAGES["scene_page"]


def run(folder: Path, options: PageOptions, host: str, port: int, *, browse: bool = False) -> None:
    """Serve the page of a scene until Ctrl-C. Phrases that the page does not know are asked here.

    Args:
        folder: folder of a scene or a variant.
        host, port: see ``PageServer``.
        browse: whether the browser of the desktop opens the page.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others; its OpenCLIP is missing; or the port
            is in use.
    """
    check_scene_folder(folder, _PAGE.inputs)
    # Before the page is made, which takes seconds.
    with PageServer(host, port) as server:
        server.offer(*open_page(folder, options))
        try:
            log(f"{server.address} shows {folder}. Ctrl-C ends it.")
            if browse:
                webbrowser.open(server.address)
            server.serve_forever()
        except KeyboardInterrupt:
            log("ended")


def write_page(folder: Path, output: Path, options: AskingOptions, title: str | None = None) -> None:
    """Write the scene page of a finished scene; its title is ``dataset/scene`` unless given. Raises as the stage."""
    paths = {path.stem: path for path in locate_for_page(folder)}
    page = page_options(open_artifact(paths["features"], SCHEMAS["features"]), options)
    run_stage(_PAGE.name, page, **paths, output=output, title=title or title_of(folder))


def page_options(features: Artifact, options: AskingOptions) -> ScenePageOptions:
    """The options of a page: what is not set follows the models that made the features."""
    clip = features.facts["clip"]
    given = {name: getattr(options, name) for name in options.model_fields_set}
    files = {"clip_model": clip["model"], "clip_checkpoint": clip["checkpoint"]}
    return ScenePageOptions(**files | given).suit(clip["model"])


def open_page(folder: Path, options: PageOptions) -> tuple[str, Ask]:
    """The page of a scene, and what answers phrases that the page does not know; errors as in ``run``."""
    paths = locate_for_page(folder)
    artifacts = {path.stem: open_artifact(path, SCHEMAS[path.stem]) for path in paths}
    page_keys = page_options(artifacts["features"], options)

    @cache
    def scene() -> Any:
        # Here, because PyTorch takes seconds to import, which a page that is there does not need.
        from egosplat.query.finished_scene import scene_of

        return scene_of(artifacts.values(), page_keys)

    page, facts = _written_page(folder, artifacts, page_keys) or (None, {})
    if page is None:
        from egosplat.viewing.stage import make_page

        log(f"{folder}: making the page")
        page, facts = make_page(scene(), page_keys, title_of(folder))
    if not facts["tower"]:
        # Nothing else encodes words: an OpenCLIP that is missing is told at once.
        scene().clip  # noqa: B018
    lock = threading.Lock()

    def ask(phrase: str) -> Facts:
        from egosplat.viewing.words import ask_for_page

        with lock:
            try:
                return ask_for_page(scene(), phrase)
            except UserError as error:
                return {"why": str(error)}

    return page, ask


def locate_for_page(folder: Path) -> list[Path]:
    """The paths of what a scene's page is made of: its inputs, and histories.zarr if it is there."""
    paths = locate(folder, *_PAGE.inputs)
    splats = open_artifact(paths[_PAGE.inputs.index("splats")], SCHEMAS["splats"])
    histories = open_histories(folder, splats)
    return paths if histories is None else [*paths, histories.path]


def _written_page(
    folder: Path, artifacts: dict[str, Artifact], options: ScenePageOptions
) -> tuple[str, Facts] | None:
    """The page in the folder with its facts, if it was made from these artifacts with these options."""
    path = folder / _PAGE.output
    page = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    if not (data := data_of(page)):
        return None
    facts, _ = unpack(data)
    record = record_of(artifacts.values(), options)
    return (page, facts) if record.items() <= facts.items() else None
