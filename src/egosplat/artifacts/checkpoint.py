"""Checkpoints inside a long stage: what was reached survives a kill, and a rerun goes on from there.

A checkpoint lies in a hidden folder beside the output, because the workflow deletes outputs before it makes
them. It names what it belongs to (options, inputs, code and library versions), and one of anything else
is never resumed. Its own hash tells a damaged one, which is not resumed either.
"""

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

State = dict[str, Any]
"""Tensors, numbers, texts, and lists and dictionaries of them."""

_DIGEST_BYTES = 32


class Checkpoint:
    """The checkpoint of the artifact at ``output``."""

    def __init__(self, output: Path, key: str, every_s: float) -> None:
        """``key``: what it belongs to, see ``key_of``. ``every_s``: wall time between two [s]."""
        self.file = output.parent / f".{output.name}.checkpoint" / "state"
        self._key = key
        self._every_s = every_s
        self._saved = time.monotonic()

    def load(self) -> State | None:
        """The state to go on from, tensors on the CPU; None where there is none for this key."""
        try:
            content = self.file.read_bytes()
        except FileNotFoundError:
            return None
        digest, body = content[:_DIGEST_BYTES], memoryview(content)[_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != digest:
            log(f"{self.file}: the checkpoint is damaged; the stage starts anew")
            return None
        saved = torch.load(io.BytesIO(body), map_location="cpu", weights_only=True)
        if saved["key"] != self._key:
            log("the checkpoint is of other options, inputs or code; the stage starts anew")
            return None
        return saved["state"]

    def save_if_due(self, state: Callable[[], State]) -> None:
        """Write ``state()`` where the last checkpoint is long enough ago.

        One that cannot be written, on a full disk say, is told and does not end the stage.
        """
        if time.monotonic() - self._saved < self._every_s:
            return
        try:
            self._save(state())
        except OSError as error:
            log(f"warning: no checkpoint: {self.file}: {error.strerror}")
        # From the end of writing: a slow disk must not take all the time.
        self._saved = time.monotonic()

    def remove(self) -> None:
        """Remove it, and what a killed writer left of one."""
        shutil.rmtree(self.file.parent, ignore_errors=True)

    def _save(self, state: State) -> None:
        stream = io.BytesIO()
        torch.save({"key": self._key, "state": state}, stream)
        body = stream.getbuffer()
        with atomic_file(self.file) as scratch, scratch.open("wb") as file:
            file.write(hashlib.sha256(body).digest())
            file.write(body)
