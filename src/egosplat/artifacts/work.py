"""The work of a stage that treats frames apart: of one job, or of a job for each chunk and one that gathers their results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.checkpoint import Checkpoint, UnusableState, read_state, write_state
from egosplat.artifacts.provenance import Provenance, key_of
from egosplat.errors import UserError
from egosplat.pipeline.chunks import split_frames
from egosplat.progress import log, track

Chunks = list[range]


class Work:
    """The work of a job on the frames of a recording. A killed job resumes.

    Attributes:
        costs: time and memory of the jobs whose results are gathered.
    """

    def __init__(
        self,
        output: Path,
        made: Provenance,
        frames: int,
        chunk: int | None = None,
        gather: Sequence[Path] = (),
        more: Mapping[str, Any] | None = None,
    ) -> None:
        """Set up for a recording of a number of frames.

        Args:
            made: what decides the results, with ``more``; see ``provenance.key_of``.
            chunk: number from 1 of the chunk to work on, whose results are the output; None for all.
            gather: outputs of the jobs of all chunks, in order, instead of any work.

        Raises:
            UserError: the recording has no such chunk.
        """
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
        """Do the work; None if it is that of a chunk, whose results are written.

        Args:
            plan: gets chunks of frames, and returns the units of work on them.
            do: gets units, and yields the result of each: tensors, numbers, texts, and lists and dictionaries of them.
            what, unit: as in ``track``.

        Raises:
            UserError: what is to be gathered is damaged, of another run, or not all of it.
        """
        if self._gather:
            return self._gathered()
        units = plan(self._chunks if self._chunk is None else [self._chunks[self._chunk - 1]])
        done: list[Any] = (self._checkpoint.load() or {"done": []})["done"]
        if done:
            log(f"{what} resumes after {len(done)} of {len(units)} {unit}s")
        for one in track(do(units[len(done) :]), what, len(units) - len(done), unit):
            done.append(one)
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
        numbers = [one["chunk"] for one in states]
        if numbers != [*range(1, len(self._chunks) + 1)]:
            raise UserError(
                f"--gather: chunks {numbers} are given; all {len(self._chunks)} are needed, in order"
            )
        self.costs = [one["cost"] for one in states]
        return [one for state in states for one in state["done"]]


def lie_within(frames: NDArray[np.integer], chunks: Chunks) -> NDArray[np.bool_]:
    """(N,) which frames lie in chunks that follow each other."""
    return (frames >= chunks[0].start) & (frames < chunks[-1].stop)
