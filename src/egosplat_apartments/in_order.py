"""Compute several results at a time, and give them in order."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yield ``function(item)`` of each item, computed in as many threads as the job has.

    At most one result per thread waits to be taken, so that memory does not grow with the number of items.
    """
    workers = threads()
    pending: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for item in items:
                pending.append(pool.submit(function, item))
                if len(pending) > workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            # After an error, or if no more results are taken, what has not begun is not computed.
            for waiting in pending:
                waiting.cancel()


def threads() -> int:
    """Threads of this job: OMP_NUM_THREADS, which Snakemake sets, or all processors that it may use."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, int(given)) if given.isdecimal() else len(os.sched_getaffinity(0))
