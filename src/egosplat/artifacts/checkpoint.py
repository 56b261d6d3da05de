"""Checkpoints of a long stage: a killed stage continues from the last one."""

import hashlib
import io
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from egosplat.files import atomic_file
from egosplat.progress import log

# Tensors, numbers, texts, and lists and dictionaries of them.
State = dict[str, Any]

_DIGEST_BYTES = 32

# Wall time between two checkpoints [s]: a killed stage loses a minute.
EVERY_S = 60.0

# A write that takes longer [s] is waited for as many times longer, so that checkpoints take a twentieth of the time at most.
SLOW_S = EVERY_S / 20


class UnusableState(Exception):
    """A file holds no state to continue from; the text says why."""


class Checkpoint:
    """The checkpoint of the artifact at ``output``."""

    def __init__(self, output: Path, key: str, every_s: float | None = None, part: str = "") -> None:
        """Set up, without reading or writing.

        Args:
            key: hash of all that decides the result (``provenance.key_of``).
            every_s: time between checkpoints [s].
            part: of the stage, if it has several checkpoints.
        """
        # Next to the output and not in it, because the workflow deletes outputs before it makes them.
        self._folder = output.parent / f".{output.name}.checkpoint"
        self.file = self._folder / part / "state"
        self._key = key
        self._wait_s = self._every_s = EVERY_S if every_s is None else every_s
        self._saved = time.monotonic()

    def load(self) -> State | None:
        """The state to continue from, with tensors on the CPU; None if there is none with this key."""
        try:
            return read_state(self.file, self._key)
        except FileNotFoundError:
            return None
        except UnusableState as error:
            log(f"{self.file}: {error}; the stage starts again")
            return None

    def save_if_due(self, state: Callable[[], State]) -> None:
        """Write ``state()`` if the last checkpoint is ``every_s`` old, see also ``SLOW_S``. A failed write is only logged."""
        begun = time.monotonic()
        if begun - self._saved < self._wait_s:
            return
        try:
            write_state(self.file, self._key, state())
        # A full disk may have room again later; without a checkpoint, only a kill loses work.
        except OSError as error:
            log(f"warning: no checkpoint: {self.file}: {error.strerror}")
        # Counted from the end of the write, so that a slow disk does not take all the time.
        self._saved = time.monotonic()
        self._wait_s = self._every_s * max(1.0, (self._saved - begun) / SLOW_S)

    def remove(self) -> None:
        """Remove the checkpoints of all parts, and the scratch files of killed writers."""
        shutil.rmtree(self._folder, ignore_errors=True)


def read_state(file: Path, key: str) -> State:
    """Read a state with tensors on the CPU (UnusableState: damaged, or of another key)."""
    content = file.read_bytes()
    digest, body = content[:_DIGEST_BYTES], memoryview(content)[_DIGEST_BYTES:]
    if hashlib.sha256(body).digest() != digest:
        raise UnusableState("is damaged")
    # ``weights_only``: a state is data, and must not run code.
    saved = torch.load(io.BytesIO(body), map_location="cpu", weights_only=True)
    # Other options, inputs, code or library versions would give another result than a run from the beginning.
    if saved["key"] != key:
        raise UnusableState("has other options, inputs or code")
    return saved["state"]


def write_state(file: Path, key: str, state: State) -> None:
    """Write a state, whole or not at all."""
    stream = io.BytesIO()
    torch.save({"key": key, "state": state}, stream)
    body = stream.getbuffer()
    with atomic_file(file) as scratch, scratch.open("wb") as out:
        out.write(hashlib.sha256(body).digest())
        out.write(body)
