"""Fetch a file over HTTP: continue an interrupted download, verify the digest, and replace nothing."""

import contextlib
import fcntl
import hashlib
import http.client
import os
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from egosplat.errors import NO_ROOM, UserError
from egosplat.files import atomic_file
from egosplat.progress import log, track

# Bytes that are read, written and counted at once.
CHUNK = 2**20

# Attempts before the command gives up; each continues where the last one broke off.
ATTEMPTS = 5

# Longest wait for an answer, and for more bytes [s].
TIMEOUT_S = 30.0

# Pause before the second attempt [s]; each further pause is twice as long.
PAUSE_S = 1.0

# HTTP statuses of a server that is overloaded or being restarted.
BUSY = (408, 429, 500, 502, 503, 504)

CONTINUES = "The same command continues the download"


class OfflineError(UserError):
    """No connection to a server."""


class _BrokenError(Exception):
    """The connection broke off; another attempt may succeed."""


class _NothingLeftError(Exception):
    """The server has no bytes from the requested one on. The argument is the size of its file, as text."""


def fetch(address: str, path: Path, sha256: str | None) -> str:
    """Download a file. It appears under its name complete and verified, or not at all.

    Proxies are those of the environment (``https_proxy``, ``no_proxy``). The bytes of an interrupted download stay in
    ``PATH.part``, and the next call continues there. ``PATH.sha256`` holds the digest, as ``sha256sum`` writes it.

    Args:
        address: ``https://...`` or ``http://...``.
        path: must not exist.
        sha256: expected digest; None accepts any content.

    Returns:
        The digest, 64 hexadecimal digits.

    Raises:
        OfflineError: the server cannot be reached.
        UserError: the server refuses, the connection keeps breaking, the disk is too small, or the digest is wrong.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = _beside(path, ".part")
    with part.open("ab") as file:
        _lock(file, path)
        try:
            _complete(address, path, file, sha256 is not None)
        except UserError:
            if not fetched_bytes(path):
                _forget(path)
            raise
        os.fsync(file.fileno())
        found = _digest(part)
        if sha256 not in (None, found):
            _forget(path)
            raise UserError(
                f"{address}: the file has SHA-256 {found}, published is {sha256}: it is damaged, or another file.\n"
                "It is removed. Start the command again; if that does not help, report it"
            )
        os.replace(part, path)
    _forget(path)
    write_digest(path, found)
    return found


def stored_digest(path: Path) -> str | None:
    """Get the digest that was stored when a file was fetched; None if there is none."""
    with contextlib.suppress(OSError, ValueError):
        words = _beside(path, ".sha256").read_text(encoding="utf-8").split()
        return words[0] if words else None
    return None


def write_digest(path: Path, digest: str) -> None:
    """Store the digest of a file next to it, for ``sha256sum --check``."""
    with atomic_file(_beside(path, ".sha256")) as scratch:
        scratch.write_text(f"{digest}  {path.name}\n", encoding="utf-8")


def fetched_bytes(path: Path) -> int:
    """Size of an interrupted download [bytes]; 0 if there is none."""
    try:
        return _beside(path, ".part").stat().st_size
    except OSError:
        return 0


def _complete(address: str, path: Path, file: IO[bytes], verified: bool) -> None:
    """Append the rest of a file, in several attempts if necessary."""
    for attempt in range(ATTEMPTS):
        try:
            return _append(address, path, file, verified)
        except _NothingLeftError as error:
            if str(error) == str(file.seek(0, os.SEEK_END)):
                return None  # a process was killed between the last byte and the new name
            file.truncate(0)
            reason = "the file on the server became shorter"
        except _BrokenError as error:
            reason = str(error)
        if attempt + 1 < ATTEMPTS:
            log(f"{path.name}: {reason}; trying again")
            time.sleep(PAUSE_S * 2**attempt)
    raise UserError(f"{address}: {reason}, {ATTEMPTS} times. {CONTINUES}")


def _append(address: str, path: Path, file: IO[bytes], verified: bool) -> None:
    tag = _beside(path, ".etag")
    start = file.seek(0, os.SEEK_END)
    if start and not verified and not tag.is_file():
        start = file.truncate(0)  # without digest and tag, the rest may be of another version of the file
    with _asked(address, start, tag) as answer:
        if _is_rest(answer, start):
            log(f"{path.name}: continuing at {start / 1e6:,.1f} MB")
        else:
            start = file.truncate(0)
        _write_tag(tag, answer.headers.get("ETag"))
        length = answer.headers.get("Content-Length")
        left = int(length) if length else None
        if left is None and not verified:
            raise UserError(
                f"{address}: the server does not tell the size, and no digest is known to verify the file"
            )
        _check_room(path, left)
        for chunk in track(_chunks(answer), path.name, left and -(-left // CHUNK), unit="megabyte"):
            _write(file, chunk, path)
    size = file.seek(0, os.SEEK_END)
    if left is not None and size != start + left:
        raise _BrokenError(f"the connection broke off at {size / 1e6:,.1f} of {(start + left) / 1e6:,.1f} MB")


def _asked(address: str, start: int, tag: Path) -> http.client.HTTPResponse:
    """Send a request for the bytes from ``start`` on."""
    headers = {"User-Agent": "egosplat", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if tag.is_file():
            headers["If-Range"] = tag.read_text(encoding="utf-8")
    try:
        # A new opener reads the proxies of the environment.
        request = urllib.request.Request(address, headers=headers)
        answer = urllib.request.build_opener().open(request, timeout=TIMEOUT_S)
    except urllib.error.HTTPError as error:
        with error:
            if error.code == 416 and start:
                raise _NothingLeftError(error.headers.get("Content-Range", "").rpartition("/")[2]) from None
            if error.code in BUSY:
                raise _BrokenError(f"the server answers {error.code} {error.reason}") from None
            raise UserError(f"{address}: the server answers {error.code} {error.reason}") from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, TimeoutError | ConnectionResetError):
            raise _BrokenError(str(error.reason)) from None
        raise OfflineError(f"{address}: no connection ({error.reason})") from None
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from None
    if answer.headers.get_content_type() == "text/html":
        answer.close()
        raise UserError(
            f"{address}: the server answers with a web page. Open it in a browser: it may ask to log in"
        )
    return answer


def _is_rest(answer: http.client.HTTPResponse, start: int) -> bool:
    """Whether an answer holds the bytes from ``start`` on; a server may send the whole file."""
    return (
        start > 0
        and answer.status == 206
        and answer.headers.get("Content-Range", "").startswith(f"bytes {start}-")
    )


def _chunks(answer: http.client.HTTPResponse) -> Iterator[bytes]:
    try:
        while chunk := answer.read(CHUNK):
            yield chunk
    except http.client.IncompleteRead as error:
        yield error.partial
        raise _BrokenError("the connection broke off") from None
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from None


def _write(file: IO[bytes], chunk: bytes, path: Path) -> None:
    try:
        file.write(chunk)
        file.flush()  # a killed process loses nothing
    except OSError as error:
        if error.errno in NO_ROOM:
            raise UserError(f"{path}: {error.strerror}. {_make_room()}") from None
        raise


def _check_room(path: Path, left: int | None) -> None:
    free = shutil.disk_usage(path.parent).free
    if left is not None and free < left:
        raise UserError(f"{path}: needs {left / 1e6:,.1f} MB, {free / 1e6:,.1f} MB are free. {_make_room()}")


def _make_room() -> str:
    return f"Make room, or set models.cache to a folder on another disk. {CONTINUES}"


def _lock(file: IO[bytes], path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UserError(f"{path}: another process is fetching it; wait for it") from None
    # The file may have been completed between the caller's look and the lock.
    if path.exists():
        raise UserError(f"{path}: another process has just fetched it; start the command again")


def _write_tag(tag: Path, value: str | None) -> None:
    # Weak tags are not allowed in If-Range.
    if value and not value.startswith("W/"):
        tag.write_text(value, encoding="utf-8")
    else:
        tag.unlink(missing_ok=True)


def _forget(path: Path) -> None:
    for suffix in (".part", ".etag"):
        _beside(path, suffix).unlink(missing_ok=True)


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
