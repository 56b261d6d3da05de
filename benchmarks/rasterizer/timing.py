"""Timing on a shared machine: the candidates take turns, each in a process of its own.

A busy moment then affects all of them. Processor time of one thread leaves out other processes, except for their use of caches
and clock rates.
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
class Turn:
    """A candidate.

    Attributes:
        worker: the process in which it runs.
        call: function and arguments; the function returns a processor time [ms].
        rounds: number of samples.
        warm_up: whether one more call comes first, without a sample.
    """

    worker: ProcessPoolExecutor
    call: tuple[Callable[..., float], *tuple[Any, ...]]
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


def sample(run: Callable[[], Any]) -> float:
    """Processor time of one call in this process, on one thread [ms]."""
    torch.set_num_threads(1)
    start = time.process_time()
    run()
    return 1e3 * (time.process_time() - start)


def take_turns(turns: Mapping[str, Turn]) -> dict[str, list[float]]:
    """Call all candidates in turn, each the number of times that it states, and collect their samples."""
    collected: dict[str, list[float]] = {name: [] for name in turns}
    for round_ in range(1 + max(turn.rounds for turn in turns.values())):
        for name, turn in turns.items():
            if (round_ or turn.warm_up) and round_ <= turn.rounds:
                result = turn.worker.submit(*turn.call).result()
                if round_:
                    collected[name].append(result)
    return collected


def summary(samples: Iterable[float]) -> dict[str, float]:
    """Median and minimum of processor times [ms]."""
    samples = list(samples)
    return {"cpu_ms_median": round(median(samples), 2), "cpu_ms_min": round(min(samples), 2)}
