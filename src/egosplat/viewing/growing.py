"""A page on a scene that is being made: pictures of what is there so far, and what the step at work says last."""

import contextlib
import os
import threading
import webbrowser
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.files import scratch_directory
from egosplat.pipeline.home import title_of
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.report.html_page import read_picture
from egosplat.viewing.html import page_source
from egosplat.viewing.server import PageServer

# Seconds between two looks at the folder, and for which the end of a run waits for a picture.
_EVERY_S, _PATIENCE_S = 2.0, 5.0

# The stages that draw, in the order of the page, each with what it draws; the first draws again with more.
_SHEETS = [("contact_sheet", ("frames",)), ("contact_sheet", ("frames", "poses"))]
_SHEETS += [(name, STAGES[name].inputs) for name in ("splats_sheet", "instances_sheet", "crops_sheet")]


@contextlib.contextmanager
def growing_page(server: PageServer, folder: Path) -> Iterator[None]:
    """Serve the page of a folder inside this context, and open it in the browser. A thread of the lowest priority draws."""
    done = threading.Event()
    told: dict[str, Any] = {"title": title_of(folder), "last": "", "pictures": {}}
    server.offer(page_source("growing.html"), lambda **asked: told)
    works = (server.serve_forever, lambda: _fill(told, folder, done), lambda: webbrowser.open(server.address))
    threads = [threading.Thread(target=work, daemon=True) for work in works]
    for thread in threads:
        thread.start()
    log(f"{server.address} shows what is there so far")
    try:
        yield
    finally:
        done.set()
        threads[1].join(_PATIENCE_S)
        server.shutdown()


def _fill(told: dict[str, Any], folder: Path, done: threading.Event) -> None:
    """Draw what is new, and read what the step at work says, again and again."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
    drawn: set[tuple[int, ...]] = set()
    training = Checkpoint(folder / "splats.zarr", "").picture
    with scratch_directory("egosplat-growing-") as scratch:
        while not done.wait(_EVERY_S):
            logs = Path("logs", *folder.parts[1:]).glob("*.log")
            newest = max(logs, key=os.path.getmtime, default=Path(os.devnull))
            # A step that begins has said nothing.
            told["last"] = "".join(newest.read_text(errors="replace").splitlines()[-1:]) or told["last"]
            for name, inputs in _SHEETS:
                # What is not there yet, or is being replaced, is drawn another time.
                with contextlib.suppress(UserError, OSError):
                    paths = {f"{one}_path": folder / f"{one}.zarr" for one in inputs}
                    made = tuple(path.stat().st_mtime_ns for path in paths.values())
                    if made not in drawn and not done.is_set():
                        output = scratch / f"{name}.png"
                        import_module(STAGES[name].module).run(**paths, output=output, title=told["title"])
                        told["pictures"] = {**told["pictures"], name: read_picture(output)}
                        drawn.add(made)
            # Of a training at work; the sheet of its stage takes its place.
            with contextlib.suppress(UserError, OSError):
                made = (training.stat().st_mtime_ns,)
                if made not in drawn:
                    told["pictures"] = {**told["pictures"], "splats_sheet": read_picture(training)}
                    drawn.add(made)
