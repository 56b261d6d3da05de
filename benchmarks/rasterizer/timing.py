"""Timing on a shared machine: the candidates take turns, each in a process of its own.

A busy moment then affects all of them. Processor time of one thread leaves out other processes, except for their use of caches
and clock rates. On two threads, only the best wall time is meaningful.
"""

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from statistics import median
from typing import Any

import torch

from egosplat.rasterize.kernels.library import VARIABLE


@dataclass(frozen=True)
class Sample:
    """Processor and wall time of one call [ms]."""

    cpu_ms: float
    wall_ms: float


@dataclass(frozen=True)
class Turn:
    """A candidate.

    Attributes:
        worker: the process in which it runs.
        call: function and arguments; the function returns a ``Sample``.
        rounds: number of samples.
        warm_up: whether one more call comes first, without a sample.
    """

    worker: ProcessPoolExecutor
    call: tuple[Callable[..., Sample], *tuple[Any, ...]]
    rounds: int
    warm_up: bool


def start_worker(variant: str | None) -> ProcessPoolExecutor:
    """A process whose kernels are those of ``variant`` (None: the best that the processor runs)."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, context, initializer=_choose, initargs=(variant,))


def _choose(variant: str | None) -> None:
    os.environ.pop(VARIABLE, None)
    if variant is not None:
        os.environ[VARIABLE] = variant


def sample(run: Callable[[], Any], threads: int) -> Sample:
    """Time one call in this process."""
    torch.set_num_threads(threads)
    cpu, wall = time.process_time(), time.perf_counter()
    run()
    return Sample(1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall))


def take_turns(turns: Mapping[str, Turn]) -> dict[str, list[Sample]]:
    """Call all candidates in turn, each the number of times that it states, and collect their samples."""
    collected: dict[str, list[Sample]] = {name: [] for name in turns}
    for round_ in range(1 + max(turn.rounds for turn in turns.values())):
        for name, turn in turns.items():
            if (round_ or turn.warm_up) and round_ <= turn.rounds:
                result = turn.worker.submit(*turn.call).result()
                if round_:
                    collected[name].append(result)
    return collected


def summary(samples: Iterable[Sample]) -> dict[str, float]:
    """Median and minimum of the processor time, and minimum of the wall time [ms]."""
    samples = list(samples)
    cpu = [one.cpu_ms for one in samples]
    return {
        "cpu_ms_median": round(median(cpu), 2),
        "cpu_ms_min": round(min(cpu), 2),
        "wall_ms_min": round(min(one.wall_ms for one in samples), 2),
    }
