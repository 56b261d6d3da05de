"""The rasterizers against each other."""

import importlib.util
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from benchmarks.rasterizer import rasterizers
from benchmarks.rasterizer.timing import Turn, start_worker, summary, take_turns
from egosplat.errors import UserError
from egosplat.kernels import library
from egosplat.kernels.targets import HERE, VARIANTS

CHANNELS = (3, 12)
PEERS = ("numba", "torch")

ROUNDS = {"kernels": 15, "numba": 7, "torch": 2}
WALL_ROUNDS = {"kernels": 20, "numba": 5}
"""Without torch, whose many small loops wait for one another for seconds where a core is busy otherwise."""

QUICK_ROUNDS = {"kernels": 15, "numba": 5, "torch": 2}

MAX_ERROR = 1e-3
"""Relative difference (L2) of images or gradients above which two rasterizers do not do the same work."""

Workers = dict[str, ProcessPoolExecutor]
Rows = list[dict[str, Any]]


def variants() -> list[str]:
    """Names of the kernels' variants that are compiled and that this processor runs, the best first.

    Raises:
        UserError: there is none.
    """
    library.load()
    features = library.cpu_features()
    return [each.name for each in VARIANTS if each.features <= features and (HERE / each.file).is_file()]


@contextmanager
def workers(names: Sequence[str]) -> Iterator[Workers]:
    """A process for each variant of the kernels, for ``torch`` and for ``numba``, by name."""
    known = {each.name for each in VARIANTS}
    if "numba" in names and importlib.util.find_spec("numba") is None:
        raise UserError("the benchmark compares with numba, which is missing; run: pip install -e '.[dev]'")
    with ExitStack() as stack:
        pool = {name: stack.enter_context(start_worker(name if name in known else None)) for name in names}
        # All import what they need at the same time, and nothing is timed before.
        for ready in [worker.submit(rasterizers.variant) for worker in pool.values()]:
            ready.result()
        yield pool


def quick() -> Rows:
    """Scene D with the variant that the library loads, numba and torch, in rows like those of ``everything``."""
    with workers([library.variant(), "numba", "torch"]) as pool:
        return [row for count in CHANNELS for row in compare(pool, "D", count, QUICK_ROUNDS, {})]


def check_agreement(pool: Workers) -> None:
    """Check that all rasterizers give the same image and gradients on scene A.

    Raises:
        UserError: one does not.
    """
    for count in CHANNELS:
        results = {
            name: worker.submit(rasterizers.outputs, _kind(name), "A", count).result()
            for name, worker in pool.items()
        }
        for name, tensors in results.items():
            for tensor, wanted in zip(tensors, results["torch"], strict=True):
                error = float((tensor - wanted).norm() / wanted.norm())
                if not error <= MAX_ERROR:
                    raise UserError(f"{name} and torch differ by {error:.1e}: they do not do the same work")


def compare(
    pool: Workers,
    scene: str,
    count: int,
    rounds: dict[str, int],
    wall_rounds: dict[str, int],
    kernels: str = "kernels",
) -> Rows:
    """Forward and backward pass on a scene with ``count`` channels: a row for each in ``pool``.

    Args:
        rounds: how often each kind (kernels, numba, torch) takes part on one thread.
        wall_rounds: the same on two threads; kinds that are missing take no part.
        kernels: which of the kernels' entries in ``rasterizers.PREPARE`` is timed.
    """

    def turns(chosen: dict[str, int], threads: int) -> dict[str, Turn]:
        return {
            name: Turn(
                worker,
                (rasterizers.sample, _kind(name, kernels), scene, count, threads),
                chosen[_kind(name)],
                # torch takes seconds a call: beginning shows in none of them.
                warm_up=name != "torch",
            )
            for name, worker in pool.items()
            if _kind(name) in chosen
        }

    one = {name: summary(samples) for name, samples in take_turns(turns(rounds, 1)).items()}
    rows = [{"scene": scene, "channels": count, "rasterizer": name, **times} for name, times in one.items()]
    if wall_rounds:
        two = {name: summary(samples) for name, samples in take_turns(turns(wall_rounds, 2)).items()}
        for row in rows:
            if row["rasterizer"] in two:
                row["wall_ms_min_2_threads"] = two[row["rasterizer"]]["wall_ms_min"]
    return rows


def ratio(rows: Rows, scene: str, channels: int, name: str, peer: str) -> float:
    """How many times the processor time of ``name`` does ``peer`` need? By the minima, which others disturb least."""
    return (
        find_row(rows, scene, channels, peer)["cpu_ms_min"]
        / find_row(rows, scene, channels, name)["cpu_ms_min"]
    )


def find_row(rows: Rows, scene: str, channels: int, name: str) -> dict[str, Any]:
    """The row of one rasterizer on one scene."""
    return next(
        row for row in rows if (row["scene"], row["channels"], row["rasterizer"]) == (scene, channels, name)
    )


def _kind(name: str, kernels: str = "kernels") -> str:
    """The entry in ``rasterizers.PREPARE``."""
    return name if name in ("numba", "torch") else kernels
