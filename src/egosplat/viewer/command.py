"""Show scenes in the browser until the user ends it: ``egosplat view``."""

import importlib.util
import logging
import socket
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from egosplat.errors import UserError
from egosplat.files import user_cache
from egosplat.progress import log
from egosplat.query.options import QueryOptions
from egosplat.viewer.questions import Questions, open_questions
from egosplat.viewer.scene import ViewedScene, open_scene
from egosplat.viewer.session import Session
from egosplat.viewer.world import FIELD_OF_VIEW, World

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer


class Viewer:
    """A server of scenes that runs until it is closed.

    Attributes:
        address: where the browser finds it.
    """

    def __init__(
        self, worlds: Sequence[World], load: Callable[[ViewedScene], Questions], host: str, port: int
    ) -> None:
        """Start to serve, and to make the scenes ready for questions.

        Args:
            load: opens the questions of a scene.
            host: address of the network interface.
            port: of the server; 0 takes a free one.

        Raises:
            UserError: the port is in use, or this computer has no such interface.
        """
        self._worlds, self._load = worlds, load
        self._sessions: dict[int, Session] = {}
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._server = _serve(host, port)
        self.address = f"http://{host}:{self._server.get_port()}"
        self._place_camera(worlds[0])
        self._server.on_client_connect(self._opened)
        self._server.on_client_disconnect(self._closed)
        threading.Thread(target=self._prepare, daemon=True, name="questions").start()

    def close(self) -> None:
        """End all windows' threads and the server."""
        self._ended.set()
        with self._lock:
            for session in self._sessions.values():
                session.close()
        self._server.stop()

    def _place_camera(self, world: World) -> None:
        viewed, start = world.viewed, self._server.initial_camera
        pose = viewed.camera_to_world[world.first_frame]
        start.up, start.fov = viewed.up, FIELD_OF_VIEW
        start.position = pose[:3, 3]
        # The camera orbits around this point, so it is on the surface in view.
        start.look_at = world.point_ahead(pose)
        self._server.scene.set_up_direction(viewed.up)

    def _opened(self, client: "ClientHandle") -> None:
        session = Session(client, self._worlds)
        with self._lock:
            self._sessions[client.client_id] = session

    def _closed(self, client: "ClientHandle") -> None:
        with self._lock:
            session = self._sessions.pop(client.client_id, None)
        if session is not None:
            session.close()

    def _prepare(self) -> None:
        try:
            self._make_ready()
        except Exception:
            # When the program ends, the libraries that this thread still loads go first.
            if not self._ended.is_set():
                raise

    def _make_ready(self) -> None:
        for world in self._worlds:
            world.load_questions(self._load)
            log(f"{world.name}: {world.silence or 'ready for questions'}")
            with self._lock:
                sessions = list(self._sessions.values())
            for session in sessions:
                session.questions_ready(world)


def run(
    folders: Sequence[Path],
    options: QueryOptions,
    *,
    host: str,
    port: int,
    backend: str,
    device: str,
    precision: str,
) -> None:
    """Show scenes until Ctrl-C.

    Args:
        folders: folders of scenes, at least one, each once.
        options: how questions are answered.
        host, port: see ``Viewer``.
        backend: renderer, as the key ``backend``.
        device, precision: of OpenCLIP, as the keys of the section ``models``.

    Raises:
        UserError: a scene cannot be opened, viser is not installed, or the port is in use.
    """
    check_port(host, port)
    if importlib.util.find_spec("viser") is None:
        raise UserError(
            'viser is not installed; it comes with the extra "viewer": pip install "egosplat[viewer]"'
        )
    worlds = [World(open_scene(folder, backend)) for folder in dict.fromkeys(folders)]

    def load(viewed: ViewedScene) -> Questions:
        return open_questions(
            viewed, options, device=device, precision=precision, cache=user_cache() / "viewer"
        )

    viewer = Viewer(worlds, load, host, port)
    try:
        log(f"{viewer.address} shows {', '.join(world.name for world in worlds)}. Ctrl-C ends it.")
        threading.Event().wait()
    except KeyboardInterrupt:
        viewer.close()
        log("ended")


def check_port(host: str, port: int) -> None:
    """Check that a server may listen at an address.

    Raises:
        UserError: the port is in use, or this computer has no such address.
    """
    try:
        with socket.create_server((host, port), family=_family(host)):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).partition(" (")[0]
        raise UserError(
            f"--host {host} --port {port}: the viewer cannot listen there ({reason}); give another --port"
        ) from None


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _serve(host: str, port: int) -> "ViserServer":
    import rich
    from viser import ViserServer

    # viser prints boxes through rich, and its library a line for every connection.
    rich.reconfigure(quiet=True)
    logging.getLogger("websockets").setLevel(logging.ERROR)
    server = ViserServer(host=host, port=port, label="egosplat", verbose=False)
    # viser takes the next free port if this one was taken since it was checked.
    if port not in (0, server.get_port()):
        server.stop()
        raise UserError(f"--port {port}: is in use; give another --port")
    return server
