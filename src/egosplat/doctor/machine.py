"""Check the hardware and software of this machine."""

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from egosplat.doctor.findings import Finding, Mark
from egosplat.errors import ARIA, NEEDS_ARIA, UserError
from egosplat.pipeline.config import Config

GIB = 1024**3
# Less free space is noted. A scene takes 0.2 GiB with the preset balanced, 22 GiB with the preset paper.
FREE_DISK_GIB = 5.0


def machine_findings(config: Config) -> Iterator[Finding]:
    """Python, PyTorch, GPU, compiler, kernels, processor, memory and disk, and whether they suffice."""
    import torch

    yield Finding(
        Mark.OK, "Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    )
    yield Finding(Mark.OK, "PyTorch", f"{torch.__version__}, {torch.get_num_threads()} threads")
    yield _gpu(config)
    yield _gsplat(config)
    if importlib.util.find_spec(ARIA) is None:
        yield Finding(Mark.NOTE, "projectaria-tools", "not installed", NEEDS_ARIA)
    yield _compiler()
    yield _kernels(config)
    yield _ray_caster()
    # The cores that this process may use: a container or a batch job may have fewer than the machine.
    yield Finding(Mark.OK, "cores", str(len(os.sched_getaffinity(0))))
    yield _memory()
    yield _disk()


def _gpu(config: Config) -> Finding:
    import torch

    if torch.cuda.is_available():
        name, memory = torch.cuda.get_device_name(), torch.cuda.get_device_properties(0).total_memory
        return Finding(Mark.OK, "GPU", f"{name}, {memory / GIB:.0f} GiB")
    if keys := [f"run.{key}" for key in ("backend", "device") if config["run"][key] == "cuda"]:
        return Finding(Mark.MISSING, "GPU", "PyTorch finds none", f"Set {' and '.join(keys)} to auto")
    return Finding(Mark.NOTE, "GPU", "PyTorch finds none; everything runs on the CPU")


def _gsplat(config: Config) -> Finding:
    import torch

    from egosplat.rasterize.cuda import GSPLAT_REQUIREMENT, load_gsplat, unsupported

    install, backend = "Run: pip install 'egosplat[cuda]'", config["run"]["backend"]
    # With auto, Gaussians are trained on the CPU where gsplat cannot run.
    mark = Mark.MISSING if backend == "cuda" else Mark.NOTE
    try:
        version = metadata.version("gsplat")
    except metadata.PackageNotFoundError:
        if backend == "cuda" or torch.cuda.is_available():
            return Finding(mark, "gsplat", "not installed: Gaussians cannot be trained on a GPU", install)
        return Finding(Mark.OK, "gsplat", "not installed; only a GPU needs it")
    if problem := unsupported(version):
        return Finding(mark, "gsplat", f"{version} {problem}", f"Run: pip install '{GSPLAT_REQUIREMENT}'")
    if torch.cuda.is_available() and backend in ("auto", "cuda"):
        # An installed gsplat may still not compile.
        try:
            load_gsplat()
        except UserError as error:
            return Finding(mark, "gsplat", f"{version} does not load", str(error))
    return Finding(Mark.OK, "gsplat", version)


def _compiler() -> Finding:
    from egosplat.rasterize.kernels.compiling import find_compiler

    command = find_compiler()
    if command is None:
        advice = "To recompile the kernels, install one: apt install g++"
        return Finding(Mark.NOTE, "C++ compiler", "none found", advice)
    done = subprocess.run([command[0], "--version"], capture_output=True, text=True, check=False)
    output = done.stdout.splitlines() or ["of unknown version"]
    return Finding(Mark.OK, "C++ compiler", f"{shlex.join(command)}: {output[0]}")


def _kernels(config: Config) -> Finding:
    from egosplat.rasterize.kernels import library
    from egosplat.rasterize.kernels.targets import HERE, VARIANTS

    if problem := library.why_not():
        first, _, advice = problem.partition("\n")
        mark = Mark.MISSING if config["run"]["backend"] == "cpu" else Mark.NOTE
        return Finding(mark, "kernels", first, advice)
    compiled = ", ".join(variant.name for variant in VARIANTS if (HERE / variant.file).is_file())
    return Finding(Mark.OK, "kernels", f"{library.variant()} (compiled: {compiled})")


def _ray_caster() -> Finding:
    from egosplat_apartments.rays import library

    try:
        library.load()
    except UserError as error:
        first, _, advice = str(error).partition("\n")
        return Finding(Mark.NOTE, "ray caster", first, advice)
    return Finding(Mark.OK, "ray caster", "compiled")


def _memory(meminfo: Path = Path("/proc/meminfo")) -> Finding:
    lines = (line.partition(":") for line in meminfo.read_text().splitlines())
    kib = {key: int(rest.split()[0]) for key, _, rest in lines}
    # MemAvailable includes caches that the kernel frees on demand; MemFree does not.
    free, total = kib["MemAvailable"] * 1024 / GIB, kib["MemTotal"] * 1024 / GIB
    return Finding(Mark.OK, "memory", f"{free:.1f} of {total:.1f} GiB free")


def _disk() -> Finding:
    free = shutil.disk_usage(".").free / GIB
    value = f"{free:.0f} GiB free at {Path.cwd()}"
    if free < FREE_DISK_GIB:
        return Finding(Mark.NOTE, "disk", value, "Make room, or work in a folder on another disk")
    return Finding(Mark.OK, "disk", value)
