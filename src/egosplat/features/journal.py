"""Journal of encoded batches, from which a killed run resumes.

The file begins with the hash of everything that decides the result. Each record holds its first row, its shape, float32
numbers and their hash, which detects a truncated record; it and all later ones are dropped.
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

# First row, rows, channels.
_HEAD = struct.Struct("<QQQ")

_DIGEST_BYTES = 32

Rows = NDArray[np.float32]


class Journal:
    """The journal of the artifact at ``output``."""

    def __init__(self, output: Path, key: bytes) -> None:
        """``key``: identifies the result, for example ``provenance.key_of``."""
        # Next to the output, not in it: the workflow deletes outputs before it runs a stage.
        self.file = output.parent / f".{output.name}.checkpoint" / "journal"
        self._key = key
        self._row = 0
        self._broken = False

    def resume(self) -> list[Rows]:
        """Return all complete records in order, and truncate the file after them. Another key empties the file."""
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
        """Append a record. If writing fails, for example on a full disk, log a warning and stop journaling."""
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
        """Delete the journal."""
        shutil.rmtree(self.file.parent, ignore_errors=True)

    def _cannot_write(self, error: OSError) -> None:
        self._broken = True
        log(f"warning: a killed run could not resume: {self.file}: {error.strerror}")

    def _whole(self, file: BinaryIO) -> Iterator[Rows]:
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            first, rows, channels = _HEAD.unpack(head)
            # A record of another writer, or garbage that claims gigabytes of memory.
            if first != self._row or rows * channels > 2**31:
                return
            body, digest = file.read(4 * rows * channels), file.read(_DIGEST_BYTES)
            if hashlib.sha256(head + body).digest() != digest:
                return
            yield np.frombuffer(body, "<f4").reshape(rows, channels)
            self._row += rows


def _size(rows: int, channels: int) -> int:
    return _HEAD.size + 4 * rows * channels + _DIGEST_BYTES
