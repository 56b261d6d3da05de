"""Findings of the doctor on this machine, and the page that lists them."""

import importlib.util
import platform
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import metadata

from egosplat.errors import UserError, user_message
from egosplat.pipeline.config import Config

GIB = 1024**3


class Mark(StrEnum):
    """Whether the configuration can run with what was found: not if something that it needs is missing."""

    OK = "ok"
    NOTE = "note"
    MISSING = "missing"


@dataclass(frozen=True)
class Finding:
    """One entry of the page; ``advice`` is empty if there is nothing to do."""

    mark: Mark
    what: str
    value: str
    advice: str = ""


def tried(what: str, check: Callable[[], str], mark: Mark = Mark.MISSING) -> Finding:
    """The value of a check; a finding with the mark, and the lines of the error as value and advice, if it fails."""
    try:
        return Finding(Mark.OK, what, check())
    except (UserError, OSError) as error:
        first, _, advice = (user_message(error) or str(error)).partition("\n")
        return Finding(mark, what, first, advice)


def page(findings: Sequence[Finding]) -> str:
    """The findings as aligned lines, followed by the number of missing things."""
    width, lines = max(len(finding.what) for finding in findings), []
    for finding in findings:
        lines.append(f"{finding.mark:7}  {finding.what:{width}}  {finding.value}")
        lines += [f"{'':{width + 11}}{line}" for line in finding.advice.splitlines()]
    missing = sum(finding.mark == Mark.MISSING for finding in findings)
    things = "1 thing" if missing == 1 else f"{missing} things"
    verdict = f"{things} that this configuration needs: see 'missing'" if missing else "Nothing is missing."
    return "\n".join([*lines, "", verdict])


def machine_findings(config: Config) -> Iterator[Finding]:
    """Python, PyTorch, GPU, gsplat, kernels and disk, and whether they suffice."""
    import torch

    from egosplat.rasterize.kernels import library

    def kernels() -> str:
        if problem := library.why_not():
            raise UserError(problem)
        return library.variant()

    backend = config["run"]["backend"]
    system = f"{platform.system()} {platform.machine()}"
    yield Finding(Mark.OK, "Python", f"{platform.python_version()} on {system}")
    yield Finding(Mark.OK, "PyTorch", f"{torch.__version__}, {torch.get_num_threads()} threads")
    yield _gpu(config)
    yield tried("gsplat", lambda: _gsplat(backend), Mark.MISSING if backend == "cuda" else Mark.NOTE)
    yield tried("kernels", kernels, Mark.MISSING if backend == "cpu" else Mark.NOTE)
    free = shutil.disk_usage(".").free / GIB
    yield Finding(Mark.OK, "disk", f"{free:.0f} GiB free; a scene takes 0.2, with the preset paper 22")


def _gpu(config: Config) -> Finding:
    import torch

    if torch.cuda.is_available():
        memory_gib = torch.cuda.get_device_properties(0).total_memory / GIB
        return Finding(Mark.OK, "GPU", f"{torch.cuda.get_device_name()}, {memory_gib:.0f} GiB")
    if keys := [f"run.{key}" for key in ("backend", "device") if config["run"][key] == "cuda"]:
        return Finding(Mark.MISSING, "GPU", "PyTorch finds none", f"Set {' and '.join(keys)} to auto")
    return Finding(Mark.NOTE, "GPU", "PyTorch finds none; everything runs on the CPU")


def _gsplat(backend: str) -> str:
    """The version of gsplat (UserError: Gaussians cannot be trained on the GPU that is there or asked for)."""
    import torch

    from egosplat.rasterize.cuda import load_gsplat

    if backend == "cuda" or (backend == "auto" and torch.cuda.is_available()):
        # An installed gsplat may still not compile.
        return load_gsplat().__version__
    installed = importlib.util.find_spec("gsplat")
    return metadata.version("gsplat") if installed else "not installed; only a GPU needs it"
