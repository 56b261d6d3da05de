"""A Hugging Face hub on 127.0.0.1 that has one content under every address, and misbehaves as it is told."""

import hashlib
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
        requests: address of each file that was sent so far.
    """

    def __init__(self, content: bytes, monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
        self.content, self.status, self.requests = content, 200, []
        self.headers: dict[str, str] = {}
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._environment, self._cache = monkeypatch, cache

    def __enter__(self) -> Self:
        for name in ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
            self._environment.delenv(name, raising=False)
        self._environment.setenv("HF_ENDPOINT", self.address)
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
            def do_HEAD(self) -> None:
                self.send_response(hub.status)
                # Quoted content digests are the tags of large files.
                headers = {
                    "ETag": f'"{hashlib.sha256(hub.content).hexdigest()}"',
                    "X-Repo-Commit": "0" * 40,
                    "Content-Length": str(len(hub.content) if hub.status == 200 else 0),
                }
                for name, value in (headers | hub.headers).items():
                    self.send_header(name, value)
                self.end_headers()

            def do_GET(self) -> None:
                self.do_HEAD()
                if (
                    hub.status == 200 and "/resolve/" in self.path
                ):  # else a question of the library about itself
                    hub.requests.append(hub.address + self.path)
                    self.wfile.write(hub.content)

            def log_message(self, *_: Any) -> None:
                pass

        return Handler
