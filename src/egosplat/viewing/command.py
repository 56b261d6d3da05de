"""Show a finished scene in the browser until the user ends it: ``egosplat view``."""

import threading
import webbrowser
from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import locate, open_histories
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.pipeline.scene_folder import check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.viewing.container import Facts, unpack
from egosplat.viewing.html import data_of
from egosplat.viewing.options import ScenePageOptions
from egosplat.viewing.record import record_of
from egosplat.viewing.server import Encode, PageServer

_PAGE = STAGES["scene_page"]


def run(folder: Path, keys: dict[str, Any], host: str, port: int, *, browse: bool = False) -> None:
    """Serve the page of a scene until Ctrl-C. Phrases that the page cannot encode are encoded here.

    Args:
        folder: folder of a scene or a variant.
        keys: of ``ScenePageOptions``, but for those of OpenCLIP: the one that made the features is used.
        host, port: see ``PageServer``.
        browse: whether the browser of the desktop opens the page.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others; its OpenCLIP is missing; or the port
            is in use.
    """
    check_scene_folder(folder, _PAGE.inputs)
    # Before the page is made, which takes seconds.
    with PageServer(host, port) as server:
        server.offer(*open_page(folder, keys))
        try:
            log(f"{server.address} shows {folder}. Ctrl-C ends it.")
            if browse:
                webbrowser.open(server.address)
            server.serve_forever()
        except KeyboardInterrupt:
            log("ended")


def open_page(folder: Path, keys: dict[str, Any]) -> tuple[str, Encode | None]:
    """The page of a scene, and what encodes phrases if the page does not; arguments and errors as in ``run``."""
    paths = locate_for_page(folder)
    artifacts = {path.stem: open_artifact(path, SCHEMAS[path.stem]) for path in paths}
    clip = artifacts["features"].facts["clip"]
    options = ScenePageOptions(**keys, clip_model=clip["model"], clip_checkpoint=clip["checkpoint"])
    page, facts = _written_page(folder, artifacts, options) or (None, {})
    if page is None:
        # Here, because PyTorch takes seconds to import, which a page that is there does not need.
        from egosplat.viewing.stage import make_page

        log(f"{folder}: making the page")
        page, facts = make_page(paths, options, title_of(folder))
    return page, None if facts["tower"] else phrase_encoder(artifacts["features"], options)


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


def phrase_encoder(features: Artifact, options: ScenePageOptions) -> Encode:
    """Load the OpenCLIP that made features, to encode phrases; raises UserError if it is missing or another one."""
    from egosplat.models.open_clip_loader import load_clip_of
    from egosplat.query.text import encode_phrases, explain_untaught, untaught_words

    clip = load_clip_of(
        features, options.clip_model, options.clip_checkpoint, options.device, options.precision
    )
    lock = threading.Lock()

    def encode(phrase: str) -> dict[str, Any]:
        try:
            with lock:
                vector = encode_phrases(clip, [phrase])[0].tolist()
        except UserError as error:
            return {"why": str(error)}
        why = explain_untaught(untaught_words(clip, phrase))
        return {"why": why} if why else {"vector": vector}

    return encode
