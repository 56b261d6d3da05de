"""A Hugging Face hub on 127.0.0.1 that has one content under every address, and misbehaves as it is told."""

import hashlib
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self

import pytest


class Hub:
    """The hub that ``HF_ENDPOINT`` names while the context manager is open, with an own folder in place of the user's cache.

    Attributes:
        status: HTTP status of its answers.
        headers: of its answers, in place of the right ones.
        breaks: number of bytes after which it breaks off each answer, and then is busy; None for never.
        begins: the first byte that each request of a file asked for.
        requests: address of each file that was sent so far.
        asked: how often something was asked about a file.
    """

    def __init__(self, content: bytes, monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
        self.content, self.status, self.requests, self.asked = content, 200, [], 0
        self.breaks: int | None = None
        self.begins: list[int] = []
        self.headers: dict[str, str] = {}
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._environment, self._cache = monkeypatch, cache

    def __enter__(self) -> Self:
        for name in ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
            self._environment.delenv(name, raising=False)
        self._environment.setenv("HF_ENDPOINT", self.address)
        self._environment.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", False)
        # The library reads its variables when it is imported, which an earlier test may have done.
        self._environment.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(self._cache))
        # The library repeats a first question without answer for seconds.
        self._environment.setattr("huggingface_hub.utils._http.time.sleep", lambda seconds: None)
        self._environment.setattr("huggingface_hub.constants.HF_HUB_DISABLE_TELEMETRY", True)
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def stop(self) -> None:
        """End the server; nothing answers at its address."""
        self._server.shutdown()
        self._server.server_close()

    def _handler(hub) -> type[BaseHTTPRequestHandler]:
        class Handler(BaseHTTPRequestHandler):
            def do_HEAD(self, begin: int = 0) -> None:
                hub.asked += self.command == "HEAD"
                self.send_response(206 if begin and hub.status == 200 else hub.status)
                # Quoted content digests are the tags of large files.
                headers = {
                    "ETag": f'"{hashlib.sha256(hub.content).hexdigest()}"',
                    "X-Repo-Commit": (re.findall("/resolve/([0-9a-f]{40})/", self.path) or ["0" * 40])[0],
                    "Content-Length": str(len(hub.content) - begin if hub.status == 200 else 0),
                }
                for name, value in (headers | hub.headers).items():
                    self.send_header(name, value)
                self.end_headers()

            def do_GET(self) -> None:
                begin = int(self.headers.get("Range", "bytes=0-")[6:-1])
                good = hub.status == 200  # a test may change it while this answers
                self.do_HEAD(begin)
                if good and "/resolve/" in self.path:  # else a question of the library about itself
                    hub.requests.append(hub.address + self.path)
                    hub.begins.append(begin)
                    self.wfile.write(hub.content[begin:][: hub.breaks])
                    hub.status = 200 if hub.breaks is None else 503

            def log_message(self, *_: Any) -> None:
                pass

        return Handler
