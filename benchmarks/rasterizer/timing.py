"""Timing on a machine that others use, too.

What is compared takes turns, so that a busy moment meets all of it. Processor time of one thread does not count
the time in which others run, though their use of caches and clocks shows; on two threads only the best wall
time says something.
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
from torch import Tensor

from egosplat.kernels.library import VARIABLE


@dataclass(frozen=True)
class Sample:
    """Time of one call [ms]: of the processors, and on the clock."""

    cpu_ms: float
    wall_ms: float


@dataclass(frozen=True)
class Turn:
    """Something that is timed.

    Attributes:
        worker: the process in which it runs.
        call: function and its arguments there; it returns what is to be collected.
        rounds: how often it takes part.
        warm_up: whether it is called once more before, without being collected.
    """

    worker: ProcessPoolExecutor
    call: tuple[Callable[..., Any], *tuple[Any, ...]]
    rounds: int
    warm_up: bool


def start_worker(variant: str | None) -> ProcessPoolExecutor:
    """A process of its own, in which the kernels are those of ``variant`` (None: the best)."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, context, initializer=_choose, initargs=(variant,))


def _choose(variant: str | None) -> None:
    os.environ.pop(VARIABLE, None)
    if variant is not None:
        os.environ[VARIABLE] = variant


def timed(run: Callable[[], Any], threads: int) -> Sample:
    """Time one call in the process that calls this."""
    torch.set_num_threads(threads)
    cpu, wall = time.process_time(), time.perf_counter()
    run()
    return Sample(1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall))


def take_turns(turns: Mapping[str, Turn]) -> dict[str, list[Any]]:
    """Call all in turn, each as often as it wants; what they return."""
    collected: dict[str, list[Any]] = {name: [] for name in turns}
    for round_ in range(1 + max(turn.rounds for turn in turns.values())):
        for name, turn in turns.items():
            if (round_ or turn.warm_up) and round_ <= turn.rounds:
                result = turn.worker.submit(*turn.call).result()
                if round_:
                    collected[name].append(result)
    return collected


def summary(samples: Iterable[Sample]) -> dict[str, float]:
    """Median and minimum of the processor time, minimum of the wall time [ms]."""
    samples = list(samples)
    cpu = [sample.cpu_ms for sample in samples]
    return {
        "cpu_ms_median": round(median(cpu), 2),
        "cpu_ms_min": round(min(cpu), 2),
        "wall_ms_min": round(min(sample.wall_ms for sample in samples), 2),
    }


class PhaseClock:
    """Processor time by phases: each mark gives the time since the mark before to a phase."""

    def __init__(self) -> None:
        self.cpu_ms: dict[str, float] = {}
        self.start()

    def start(self) -> None:
        """Start now."""
        self._began = time.perf_counter()
        self._last = time.process_time()

    def mark(self, phase: str) -> None:
        """End a phase, or a part of it."""
        now = time.process_time()
        self.cpu_ms[phase] = self.cpu_ms.get(phase, 0.0) + 1e3 * (now - self._last)
        self._last = time.process_time()

    @property
    def wall_ms(self) -> float:
        """Time on the clock since the start."""
        return 1e3 * (time.perf_counter() - self._began)

    def around(
        self, function: Callable[..., tuple[Tensor, ...]], forward: str, between: str, backward: str
    ) -> Callable[..., tuple[Tensor, ...]]:
        """A differentiable function that marks the end of its forward pass, and both ends of its backward pass.

        Args:
            function: what it calls; all that it returns comes from one node of the graph.
            forward: the phase that ends with its forward pass.
            between: the phase that ends where its backward pass begins.
            backward: the phase of its backward pass.
        """

        def marked(*arguments: Any) -> tuple[Tensor, ...]:
            outputs = function(*arguments)
            self.mark(forward)
            node = outputs[0].grad_fn
            node.register_prehook(lambda gradients: self.mark(between))
            node.register_hook(lambda gradients, given: self.mark(backward))
            return outputs

        return marked
