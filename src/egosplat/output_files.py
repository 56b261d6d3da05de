"""Files that commands write under names that a user gives. A command replaces only files with its own mark."""

import contextlib
import json
import shlex
import stat
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import atomic_file, check_writable, read_json

# The keyword of PNG's text chunk that names the program.
SOFTWARE = "Software"

# A mark is within this many bytes from the start of its file.
_HEAD_BYTES = 4096

_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class FileKind:
    """A kind of file that one command writes.

    Attributes:
        command: the command, as a user types it.
        suffix: how the file's name ends, in lower case.
        is_own: whether a regular file was written by the command.
    """

    command: str
    suffix: str
    is_own: Callable[[Path], bool]


def picture_kind(command: str) -> FileKind:
    """PNG pictures whose text chunk ``Software`` holds the command."""
    text = b"tEXt" + SOFTWARE.encode() + b"\0" + command.encode()
    # The whole chunk, length and checksum included: "egosplat query" must not match "egosplat query-sheet".
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return FileKind(command, ".png", lambda path: _begins(path, _PNG) and chunk in _head(path))


def text_kind(command: str, suffix: str, mark: str = "", begin: str = "") -> FileKind:
    """Files that start with ``begin`` and hold ``mark`` near their start."""
    return FileKind(
        command, suffix, lambda path: _begins(path, begin.encode()) and mark.encode() in _head(path)
    )


def json_kind(command: str, *keys: str) -> FileKind:
    """JSON files that hold an object with these keys."""
    return FileKind(command, ".json", lambda path: set(keys) <= _json_object(path).keys())


def stage_json_kind(stage: str) -> FileKind:
    """JSON files whose provenance names a stage."""
    command = "egosplat " + stage.replace("_", "-")
    return FileKind(command, ".json", lambda path: _stage(_json_object(path)) == stage)


def check_output(path: Path, kind: FileKind) -> None:
    """Check, before any work is done, that a command may write a file.

    Nothing is left behind; missing folders above it are made later.

    Raises:
        UserError: the name ends in another suffix, something is there that the command did not write, or the folder
            cannot be written.
        OSError: the system refuses to look.
    """
    _check_replaceable(path, kind)
    check_writable([path.parent])


@contextlib.contextmanager
def output_file(path: Path, kind: FileKind) -> Iterator[Path]:
    """Yield the name of a file to write, which becomes ``path`` when the block ends without error.

    Raises:
        UserError: as ``check_output``; what is there may have changed since.
    """
    _check_replaceable(path, kind)
    with atomic_file(path) as scratch:
        yield scratch


def write_text_file(path: Path, text: str, kind: FileKind) -> None:
    """Write a text in UTF-8, whole or not at all.

    Raises:
        UserError: as ``output_file``.
    """
    with output_file(path, kind) as scratch:
        scratch.write_text(text, encoding="utf-8")


def write_json(path: Path, document: Any, kind: FileKind) -> None:
    """Write a document as JSON with sorted keys, whole or not at all.

    Raises:
        ValueError: a number is not finite.
        UserError: as ``output_file``.
    """
    write_text_file(path, json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n", kind)


def _check_replaceable(path: Path, kind: FileKind) -> None:
    if path.suffix.lower() != kind.suffix:
        raise UserError(
            f"{path}: {kind.command} writes {kind.suffix} files; give --output a name that ends so"
        )
    # ``lstat``: a link is not followed, because its target may be anyone's file.
    try:
        status = path.lstat()
    except FileNotFoundError:
        return
    except NotADirectoryError:
        raise UserError(f"{path}: a file is there where a folder is needed; give another --output") from None
    if not stat.S_ISREG(status.st_mode):
        raise UserError(f"{path}: is {_what(path, status.st_mode)}; give --output the name of a regular file")
    # An empty file holds nothing that could be lost.
    if status.st_size and not kind.is_own(path):
        raise UserError(
            f"{path}: is there already and was not written by this version of {kind.command}; "
            f"give another --output, or remove it first: rm {shlex.quote(str(path))}"
        )


def _what(path: Path, mode: int) -> str:
    """Describe something that is no regular file."""
    if stat.S_ISLNK(mode):
        return f"a link to {path.readlink()}"
    if stat.S_ISDIR(mode):
        return "a folder"
    return "a device, pipe or socket"


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)


def _begins(path: Path, begin: bytes) -> bool:
    return _head(path).startswith(begin)


def _json_object(path: Path) -> dict[str, Any]:
    """The object that a file holds; an empty one for anything else."""
    try:
        document = read_json(path)
    except ValueError:
        return {}
    return document if isinstance(document, dict) else {}


def _stage(document: dict[str, Any]) -> object:
    made = document.get("provenance")
    return made.get("stage") if isinstance(made, dict) else None
