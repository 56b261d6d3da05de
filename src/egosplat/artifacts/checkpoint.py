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


class Checkpoint:
    """The checkpoint of the artifact at ``output``."""

    def __init__(self, output: Path, key: str, every_s: float | None = None) -> None:
        """Take the hash of all that decides the result (``provenance.key_of``), and the time between checkpoints [s]."""
        # Next to the output and not in it, because the workflow deletes outputs before it makes them.
        self.file = output.parent / f".{output.name}.checkpoint" / "state"
        self._key = key
        self._every_s = EVERY_S if every_s is None else every_s
        self._saved = time.monotonic()

    def load(self) -> State | None:
        """The state to continue from, with tensors on the CPU; None if there is none with this key."""
        try:
            content = self.file.read_bytes()
        except FileNotFoundError:
            return None
        digest, body = content[:_DIGEST_BYTES], memoryview(content)[_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != digest:
            log(f"{self.file}: the checkpoint is damaged; the stage starts again")
            return None
        # ``weights_only``: a checkpoint is data, and must not run code.
        saved = torch.load(io.BytesIO(body), map_location="cpu", weights_only=True)
        # Other options, inputs, code or library versions would give another result than a run from the beginning.
        if saved["key"] != self._key:
            log("the checkpoint has other options, inputs or code; the stage starts again")
            return None
        return saved["state"]

    def save_if_due(self, state: Callable[[], State]) -> None:
        """Write ``state()`` if the last checkpoint is ``every_s`` old. A failed write is only logged."""
        if time.monotonic() - self._saved < self._every_s:
            return
        try:
            self._save(state())
        # A full disk may have room again later; without a checkpoint, only a kill loses work.
        except OSError as error:
            log(f"warning: no checkpoint: {self.file}: {error.strerror}")
        # Counted from the end of the write, so that a slow disk does not take all the time.
        self._saved = time.monotonic()

    def remove(self) -> None:
        """Remove the checkpoint and the scratch files of killed writers."""
        shutil.rmtree(self.file.parent, ignore_errors=True)

    def _save(self, state: State) -> None:
        stream = io.BytesIO()
        torch.save({"key": self._key, "state": state}, stream)
        body = stream.getbuffer()
        with atomic_file(self.file) as scratch, scratch.open("wb") as file:
            file.write(hashlib.sha256(body).digest())
            file.write(body)
