"""Checkpoints of a long stage, which a killed one continues from, and the work of jobs that treat frames apart."""

import hashlib
import io
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.provenance import Provenance, key_of
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.pipeline.chunks import split_frames
from egosplat.progress import log, track

# Tensors, numbers, texts, and lists and dictionaries of them.
State = dict[str, Any]

Chunks = list[range]

# Wall time between two checkpoints [s]: a killed stage loses a minute. A write that takes longer than ``SLOW_S`` is waited
# for as many times longer, so that checkpoints take a twentieth of the time at most.
EVERY_S = 60.0
SLOW_S = EVERY_S / 20


class UnusableState(Exception):
    """A file holds no state to continue from; the text says why."""


class Checkpoint:
    """The checkpoint of the artifact at ``output``; ``picture`` is a file for what a training shows so far."""

    def __init__(self, output: Path, key: str, every_s: float | None = None, part: str = "") -> None:
        """Set up, without reading or writing; ``key`` as of ``provenance.key_of``, ``part`` of a stage with several
        checkpoints."""
        # Next to the output and not in it, because the workflow deletes outputs before it makes them.
        self._folder = output.parent / f".{output.name}.checkpoint"
        self.file, self.picture = self._folder / part / "state", self._folder / "training.png"
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
        """Write ``state()`` if the last checkpoint is ``every_s`` old. A failed write is only logged."""
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
    digest, body = content[:32], memoryview(content)[32:]
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


class Work:
    """The work of a stage that treats frames apart: of one job, or of a job for each chunk and one that gathers; a killed job
    resumes. ``costs`` are time and memory of the jobs whose results are gathered."""

    def __init__(
        self,
        output: Path,
        made: Provenance,
        frames: int,
        chunk: int | None = None,
        gather: Sequence[Path] = (),
        more: Mapping[str, Any] | None = None,
    ) -> None:
        """Set up for a recording of a number of frames (UserError: it has no such chunk); ``made`` and
        ``more`` as in ``key_of``. The output are the results of a ``chunk``, from 1, if one is given; to
        ``gather`` are outputs of all chunks, in order."""
        self._chunks = split_frames(frames)
        if chunk is not None and chunk > len(self._chunks):
            raise UserError(f"--chunk {chunk}: the recording has {len(self._chunks)}, of {frames} frames")
        self._output, self._made, self._chunk, self._gather = output, made, chunk, gather
        self._key = key_of(made, more)
        self._checkpoint = Checkpoint(output, self._key)
        self.costs: list[dict[str, Any]] = []

    def results(
        self,
        plan: Callable[[Chunks], Sequence[Any]],
        do: Callable[[Any], Iterable[Any]],
        what: str,
        unit: str = "frame",
    ) -> list[Any] | None:
        """Do the work; None if it is that of a chunk, whose results are written. ``plan`` makes units of
        chunks of frames, and ``do`` yields the result of each, a value of a ``State``; the others as in
        ``track``. UserError: what is gathered is damaged, of another run, or not all of it."""
        if self._gather:
            return self._gathered()
        units = plan(self._chunks if self._chunk is None else [self._chunks[self._chunk - 1]])
        done: list[Any] = (self._checkpoint.load() or {"done": []})["done"]
        if done:
            log(f"{what} resumes after {len(done)} of {len(units)} {unit}s")
        for result in track(do(units[len(done) :]), what, len(units) - len(done), unit):
            done.append(result)
            self._checkpoint.save_if_due(lambda: {"done": done})
        if self._chunk is None:
            return done
        write_state(self._output, self._key, {"chunk": self._chunk, "done": done, "cost": self._made.cost()})
        self.finish()
        return None

    def finish(self) -> None:
        """Remove the checkpoint; to be called when the output is written."""
        self._checkpoint.remove()

    def _gathered(self) -> list[Any]:
        states = []
        for path in self._gather:
            try:
                states.append(read_state(path, self._key))
            except OSError as error:
                raise UserError(f"--gather {path}: {error.strerror}; run the job of this chunk") from None
            except UnusableState as error:
                raise UserError(f"{path}: {error}; remove it, and run the same again") from None
        numbers, count = [state["chunk"] for state in states], len(self._chunks)
        if numbers != [*range(1, count + 1)]:
            raise UserError(f"--gather: chunks {numbers} are given; all {count} are needed, in order")
        self.costs = [state["cost"] for state in states]
        return [result for state in states for result in state["done"]]


def lie_within(frames: NDArray[np.integer], chunks: Chunks) -> NDArray[np.bool_]:
    """(N,) which frames lie in chunks that follow each other."""
    return (frames >= chunks[0].start) & (frames < chunks[-1].stop)
