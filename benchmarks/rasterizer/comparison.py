"""All measurements of the rasterizer: rows of times by scene, number of channels and rasterizer."""

import datetime
import platform
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

import torch

from benchmarks.rasterizer import iteration, passes
from benchmarks.rasterizer.scenes import SCENES
from benchmarks.rasterizer.timing import Turn, start_worker, summary, take_turns
from compiling import find_compiler
from egosplat.artifacts.provenance import machine
from egosplat.errors import UserError
from egosplat.progress import log, track
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.targets import HERE, VARIANTS

CHANNELS = (3, 12)

ROUNDS = {"kernels": 15, "torch": 2}

# Two for each of the eight cameras.
ITERATION_ROUNDS = 16

# Relative difference (L2) of images or gradients above which two rasterizers do not do the same work.
MAX_ERROR = 1e-3

Workers = dict[str, ProcessPoolExecutor]
Rows = list[dict[str, Any]]


def variants() -> list[str]:
    """Names of the compiled kernel variants that this processor runs, the best first.

    Raises:
        UserError: there is none.
    """
    library.variant()
    features = library.cpu_features()
    return [each.name for each in VARIANTS if each.features <= features and (HERE / each.file).is_file()]


@contextmanager
def workers(names: Sequence[str]) -> Iterator[Workers]:
    """A process for each kernel variant and for ``torch``, by name."""
    with ExitStack() as stack:
        pool = {name: stack.enter_context(start_worker(None if name == "torch" else name)) for name in names}
        # All of them import at the same time, before anything is timed.
        for ready in [worker.submit(passes.variant) for worker in pool.values()]:
            ready.result()
        yield pool


def everything() -> dict[str, Any]:
    """Run all measurements; this takes some minutes.

    Raises:
        UserError: the kernels are not compiled, or rasterizers disagree.
    """
    kernels = variants()
    with workers([*kernels, "torch"]) as pool:
        check_agreement(pool)
        cases = [(scene, count) for scene in SCENES for count in CHANNELS]
        raster = [row for case in track(cases, "passes") for row in compare(pool, *case)]
        pool.pop("torch")
        log("training iterations")
        iterations = [row for scene in SCENES for row in compare_iterations(pool, scene)]
    return {"machine": _machine(), "raster": raster, "iterations": iterations}


def check_agreement(pool: Workers) -> None:
    """Check that all rasterizers give the same image and gradients on scene A.

    Raises:
        UserError: one does not.
    """
    for count in CHANNELS:
        found = {name: pool[name].submit(passes.outputs, _kind(name), "A", count).result() for name in pool}
        for name, tensors in found.items():
            for tensor, wanted in zip(tensors, found["torch"], strict=True):
                error = float((tensor - wanted).norm() / wanted.norm())
                if not error <= MAX_ERROR:
                    raise UserError(f"{name} and torch differ by {error:.1e}: they do not do the same work")


def compare(pool: Workers, scene: str, count: int) -> Rows:
    """Forward and backward pass on a scene with ``count`` channels: a row for each worker."""
    turns = {}
    for name, worker in pool.items():
        kind = _kind(name)
        # torch takes seconds a call: a cold start does not show.
        turns[name] = Turn(worker, (passes.sample_pass, kind, scene, count), ROUNDS[kind], name != "torch")
    key = {"scene": scene, "channels": count}
    return [key | {"rasterizer": name, **summary(samples)} for name, samples in take_turns(turns).items()]


def compare_iterations(pool: Workers, scene: str) -> Rows:
    """A training iteration on a scene: a row for each worker."""
    # Training starts before the first sample; a warm-up would break the rounds over the cameras.
    call = (iteration.sample_iteration, scene)
    turns = {name: Turn(worker, call, ITERATION_ROUNDS, warm_up=False) for name, worker in pool.items()}
    return [
        {"scene": scene, "variant": name, **summary(samples)} for name, samples in take_turns(turns).items()
    ]


def ratio(rows: Rows, scene: str, channels: int, name: str) -> float:
    """Processor time of torch over that of ``name``, by the minima, which other work disturbs least."""
    torch_row, row = (find_row(rows, scene, channels, one) for one in ("torch", name))
    return torch_row["cpu_ms_min"] / row["cpu_ms_min"]


def find_row(rows: Rows, scene: str, channels: int, name: str) -> dict[str, Any]:
    """The row of one rasterizer on one scene."""
    case = (scene, channels, name)
    return next(row for row in rows if (row["scene"], row["channels"], row["rasterizer"]) == case)


def _kind(name: str) -> str:
    return name if name == "torch" else "kernels"


def _machine() -> dict[str, Any]:
    """The machine, compiler and libraries of the measurements."""
    compiler = find_compiler()
    version = "no compiler"
    if compiler is not None:
        said = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=True).stdout
        version = said.splitlines()[0]
    return {
        "date": datetime.date.today().isoformat(),
        "cpu": machine(),
        "compiler": version,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "kernels": library.variant(),
    }
