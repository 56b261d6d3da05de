"""What is finished of a long encoding, so that a killed run goes on where it was.

The journal lies in a hidden folder beside the output, because the workflow deletes outputs before it makes them. It
begins with the hash of all that decides the result; after that each record holds its first row, its shape, float32
numbers, and a hash of these, by which a record that was cut short is known. What follows such a one is written anew.
"""

import hashlib
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import log

_HEAD = struct.Struct("<QQQ")
"""First row, rows, channels."""

_DIGEST_BYTES = 32

Rows = NDArray[np.float32]


class Journal:
    """The journal of the artifact at ``output``."""

    def __init__(self, output: Path, key: bytes) -> None:
        """``key``: what it belongs to, such as ``provenance.key_of``."""
        self.file = output.parent / f".{output.name}.checkpoint" / "journal"
        self._key = key
        self._row = 0
        self._broken = False

    def resume(self) -> list[Rows]:
        """All whole records in order; the file is cut after the last of them, or begun anew."""
        try:
            return self._begin()
        except OSError as error:
            self._cannot_write(error)
            return []

    def _begin(self) -> list[Rows]:
        self.file.parent.mkdir(parents=True, exist_ok=True)
        with self.file.open("a+b") as file:
            file.seek(0)
            if file.read(len(self._key)) != self._key:
                file.truncate(0)
                file.write(self._key)
                return []
            records = list(self._whole(file))
            file.truncate(len(self._key) + sum(_size(*record.shape) for record in records))
        return records

    def append(self, rows: Rows) -> None:
        """Add a record; one that cannot be written, on a full disk say, is told and is the last."""
        if self._broken:
            return
        head, body = _HEAD.pack(self._row, *rows.shape), np.ascontiguousarray(rows, "<f4").tobytes()
        try:
            with self.file.open("ab") as file:
                file.write(head + body + hashlib.sha256(head + body).digest())
        except OSError as error:
            self._cannot_write(error)
        self._row += len(rows)

    def remove(self) -> None:
        """Remove it."""
        shutil.rmtree(self.file.parent, ignore_errors=True)

    def _cannot_write(self, error: OSError) -> None:
        self._broken = True
        log(f"warning: a killed run could not go on: {self.file}: {error.strerror}")

    def _whole(self, file: BinaryIO) -> Iterator[Rows]:
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            first, rows, channels = _HEAD.unpack(head)
            if first != self._row or rows * channels > 2**31:
                return
            body, digest = file.read(4 * rows * channels), file.read(_DIGEST_BYTES)
            if hashlib.sha256(head + body).digest() != digest:
                return
            yield np.frombuffer(body, "<f4").reshape(rows, channels)
            self._row += rows


def _size(rows: int, channels: int) -> int:
    return _HEAD.size + 4 * rows * channels + _DIGEST_BYTES
