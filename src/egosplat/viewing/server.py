"""A web server of one scene page, which answers phrases for it."""

import hmac
import ipaddress
import json
import re
import secrets
import socket
import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from egosplat.errors import UserError
from egosplat.viewing.html import served_html

# The answers to a ``phrase``, or to what is ``like`` an instance or gets a ``name``, as ``source/answer.js`` reads them.
Ask = Callable[..., dict[str, Any]]

_HEADERS = {
    "Cache-Control": "no-store",
    # The address may hold the token.
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}

# What a browser sends as Host: a name, which may end with a dot, or an address, and perhaps a port.
_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]*:[0-9a-f:.]*\]|[a-z0-9_-]+(?:\.[a-z0-9_-]+)*)\.?(?::[0-9]{1,5})?")


class PageServer(ThreadingTCPServer):
    """A server that listens from its construction on at ``address``; ``offer`` gives it the page.

    A page of another site must not reach it through a browser in the same network: each request's ``Host`` must be a name
    of this server, and its ``Origin``, if it has one, the server itself. Where other computers reach it, requests need the
    token of its address, too.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, host: str, port: int) -> None:
        """Listen at a host, address or name, and a port, 0 for a free one; raises UserError if that is not possible."""
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            why = f"cannot listen there ({error.strerror or error}); give another --host or --port"
            raise UserError(f"--host {host} --port {port}: {why}") from None
        bound = ipaddress.ip_address(str(self.server_address[0]))
        self.token = "" if bound.is_loopback else secrets.token_urlsafe(16)
        name = socket.gethostname() if bound.is_unspecified else host
        self.names = {name.lower(), str(bound), "localhost"}
        self.address = f"http://{f'[{name}]' if ':' in name else name}:{self.server_address[1]}/"
        self.address += f"?token={self.token}" if self.token else ""

    def offer(self, page: str, ask: Ask) -> None:
        """Set the page, and what answers for it."""
        self.page, self.ask = served_html(page, f"ask?token={self.token}&").encode(), ask

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that leaves before its answer."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: PageServer

    def do_GET(self) -> None:
        """Send the page, or answers; a name is given by POST alone, which no link does."""
        is_addressed = self._is_addressed()
        asked = urlsplit(self.path if is_addressed else "")
        given = {name: values[-1] for name, values in parse_qs(asked.query).items()}
        token = given.get("token", "").encode()
        if not is_addressed or not hmac.compare_digest(token, self.server.token.encode()):
            self._send(HTTPStatus.FORBIDDEN, "text/plain", b"Open the address that egosplat view printed.\n")
        elif asked.path == "/":
            self._send(HTTPStatus.OK, "text/html", self.server.page)
        elif asked.path == "/ask":
            keys = ("like", "name") if self.command == "POST" else ("like", "phrase")
            reply = self.server.ask(**{key: given[key] for key in keys if key in given})
            self._send(HTTPStatus.OK, "application/json", json.dumps(reply, allow_nan=False).encode())
        else:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n")

    do_POST = do_GET

    def _is_addressed(self) -> bool:
        """Whether the request is meant for this server, and comes from its own page, from a link or from no page."""
        hosts, origins = (self.headers.get_all(name, []) for name in ("Host", "Origin"))
        host = hosts[0].strip().lower() if len(hosts) == 1 else ""
        found = _HOST.fullmatch(host)
        # The address at which the connection arrived is this computer's own.
        names = self.server.names | {self.connection.getsockname()[0].removeprefix("::ffff:")}
        # A browser names no origin for what another page embeds, such as a script.
        is_embedded = self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        return (
            self.path.startswith("/")
            and found is not None
            and found["name"].strip("[]") in names
            and origins in ([], [f"http://{host}"])
            and (not is_embedded or self.headers.get("Sec-Fetch-Mode") == "navigate")
        )

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        headers = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content))}
        for name, value in (_HEADERS | headers).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: object) -> None:
        """Say nothing of a request."""
