"""An HTTP server on 127.0.0.1 that serves one file, and misbehaves as it is told."""

import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self


@dataclass
class FileServer:
    """Serves ``content`` at any path, with ranges and an ETag. A context manager.

    Attributes:
        statuses: HTTP statuses of the next answers, before normal ones.
        breaks: numbers of bytes after which the next answers break off.
        ranges: whether it honours the header Range.
        length: whether it tells the size.
        kind: the content type.
        etag: of the content.
        stall: set to let an answer that waits after ``breaks`` bytes continue; None closes the connection instead.
        requests: path and Range of each request so far.
    """

    content: bytes
    statuses: list[int] = field(default_factory=list)
    breaks: list[int] = field(default_factory=list)
    ranges: bool = True
    length: bool = True
    kind: str = "application/octet-stream"
    etag: str = '"1"'
    stall: threading.Event | None = None
    requests: list[tuple[str, str | None]] = field(default_factory=list)

    def __enter__(self) -> Self:
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.stall:
            self.stall.set()
        self._server.shutdown()
        self._server.server_close()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def _handler(outer) -> type[BaseHTTPRequestHandler]:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                asked = self.headers.get("Range")
                outer.requests.append((self.path, asked))
                if outer.statuses and (status := outer.statuses.pop(0)) != 200:
                    self.send_response(status)
                    self.end_headers()
                    return
                start = 0
                if asked and outer.ranges and self.headers.get("If-Range") in (None, outer.etag):
                    start = int(asked.removeprefix("bytes=").removesuffix("-"))
                self._send(start)

            def _send(self, start: int) -> None:
                size = len(outer.content)
                if start >= size:
                    self.send_response(416)
                    self.send_header("Content-Range", f"bytes */{size}")
                    self.end_headers()
                    return
                self.send_response(206 if start else 200)
                if start:
                    self.send_header("Content-Range", f"bytes {start}-{size - 1}/{size}")
                if outer.length:
                    self.send_header("Content-Length", str(size - start))
                self.send_header("Content-Type", outer.kind)
                self.send_header("ETag", outer.etag)
                self.end_headers()
                if not outer.breaks:
                    self.wfile.write(outer.content[start:])
                    return
                self.wfile.write(outer.content[start : start + outer.breaks.pop(0)])
                self.wfile.flush()
                if outer.stall:
                    outer.stall.wait()
                self.close_connection = True

            def log_message(self, *_: Any) -> None:
                pass

        return Handler
