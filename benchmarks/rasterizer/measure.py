"""All that the bench measures, as one dictionary that is written to rasterizer.json."""

import datetime
import os
import platform
import subprocess
from pathlib import Path
from statistics import median
from typing import Any

import torch

from benchmarks.rasterizer import iteration, rasterizers
from benchmarks.rasterizer.comparison import (
    CHANNELS,
    ROUNDS,
    WALL_ROUNDS,
    Rows,
    Workers,
    check_agreement,
    compare,
    variants,
    workers,
)
from benchmarks.rasterizer.roofline import peak_gflops
from benchmarks.rasterizer.scenes import SCENES
from benchmarks.rasterizer.timing import Turn, start_worker, take_turns
from egosplat.kernels import library
from egosplat.kernels.compiling import find_compiler
from egosplat.progress import log, track

SWEEP = (1, 3, 4, 8, 12, 16, 32)
FROZEN = (3, 12, 16, 32)
ITERATION_ROUNDS = 16
"""Every one of the eight cameras twice."""

MEMORY = (
    ("Gaussians", [(n, 640, 480, 3) for n in (10_000, 50_000, 100_000, 200_000, 400_000)]),
    ("pixels", [(50_000, w, h, 3) for w, h in ((320, 240), (640, 480), (960, 720), (1408, 1408))]),
    ("channels", [(50_000, 640, 480, c) for c in (3, 12, 32)]),
)
"""What grows, and (Gaussians, width, height, channels) of each measurement."""


def everything() -> dict[str, Any]:
    """The whole bench; takes some minutes.

    Raises:
        UserError: the kernels are not compiled, or rasterizers disagree.
    """
    kernels = variants()
    with workers([*kernels, "numba", "torch"]) as pool:
        check_agreement(pool)
        peaks = {variant: round(peak_gflops(variant), 1) for variant in kernels}
        scenes = {name: pool["numba"].submit(rasterizers.describe, name).result() for name in SCENES}
        raster = [
            row
            for scene in track(list(SCENES), "rasterizers", unit="scene")
            for count in CHANNELS
            for row in compare(pool, scene, count, ROUNDS, WALL_ROUNDS)
        ]
        alone = {name: pool[name] for name in kernels}
        log("channels")
        sweep = [row for count in SWEEP for row in compare(alone, "D", count, ROUNDS, {})]
        frozen = [row for count in FROZEN for row in compare(alone, "D", count, ROUNDS, {}, "frozen")]
        log("training iterations")
        iterations = [row for scene in SCENES for row in _iterations(alone, scene)]
    return {
        "machine": machine(),
        "scenes": scenes,
        "peak_gflops": peaks,
        "raster": raster,
        "sweep": sweep,
        "frozen": frozen,
        "iterations": iterations,
        "memory": _memory(),
    }


def _iterations(pool: Workers, scene: str) -> Rows:
    def turns(threads: int) -> dict[str, Turn]:
        call = (iteration.sample_phases, scene, threads)
        # Training has begun before the first one is timed; one more would break the epochs.
        return {name: Turn(worker, call, ITERATION_ROUNDS, warm_up=False) for name, worker in pool.items()}

    rows = []
    two = take_turns(turns(2))
    for name, samples in take_turns(turns(1)).items():
        totals = [sum(sample[phase] for phase in iteration.PHASES) for sample in samples]
        phases = {phase: round(median(sample[phase] for sample in samples), 2) for phase in iteration.PHASES}
        rows.append(
            {
                "scene": scene,
                "variant": name,
                "phases": phases,
                "cpu_ms_median": round(median(totals), 2),
                "cpu_ms_min": round(min(totals), 2),
                "wall_ms_min_2_threads": round(min(sample["wall"] for sample in two[name]), 2),
            }
        )
    return rows


def _memory() -> Rows:
    cases = dict.fromkeys(case for _, measured in MEMORY for case in measured)
    for case in track(list(cases), "peak memory", unit="case"):
        with start_worker(None) as worker:
            cases[case] = worker.submit(iteration.peak_bytes, *case).result()
    keys = ("gaussians", "width", "height", "channels")
    return [
        {"grows": grows, **dict(zip(keys, case, strict=True)), "mib": round(cases[case] / 2**20, 1)}
        for grows, measured in MEMORY
        for case in measured
    ]


def machine() -> dict[str, Any]:
    """What the numbers belong to."""
    compiler = find_compiler()
    version = "none"
    if compiler is not None:
        said = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=True).stdout
        version = said.splitlines()[0]
    return {
        "date": datetime.date.today().isoformat(),
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "compiler": version,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "kernels": library.variant(),
    }


def _cpu_model() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    facts = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    names = ("cpu family", "model")
    return (
        f"{facts.get('model name', 'unknown')} ({', '.join(f'{n} {facts[n]}' for n in names if n in facts)})"
    )
