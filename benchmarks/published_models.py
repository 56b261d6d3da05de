"""What the architectures of the published checkpoints take: loading, one frame, memory.

SAM2.1 hiera_b+ and OpenCLIP ViT-B-16 are built with random weights, saved as the published files are, loaded
back by path, and shown one frame; the loaded weights must equal the saved ones. Times do not depend on what the
weights are. Each model runs in a process of its own, whose peak memory is its own.

    OMP_NUM_THREADS=1 python benchmarks/published_models.py > benchmarks/published_models.md
"""

import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from torch import Tensor, nn

from egosplat.models.configs import sam2_config_file
from egosplat.models.open_clip_loader import build_model, load_open_clip, read_description
from egosplat.models.sam2_loader import build_predictor, load_sam2

SAM2, CLIP = "sam2.1_hiera_b+", "ViT-B-16"
FRAME = (512, 512)
POINT = np.array([[256.0, 256.0]]), np.array([1])
MIB = 1024**2

HEADER = (
    "| model | million weights | file [MiB] | what | first [CPU-s] | again [CPU-s] | peak memory [MiB] |\n"
    "| --- | ---: | ---: | --- | ---: | ---: | ---: |"
)


def save_sam2(path: Path) -> None:
    """Random weights as SAM2's authors publish theirs: below the key ``model``."""
    torch.save({"model": build_predictor(sam2_config_file(SAM2)).state_dict()}, path)


def save_clip(path: Path) -> None:
    """Random weights as OpenCLIP's authors publish theirs: the bare tensors."""
    torch.save(build_model(CLIP, read_description(CLIP, None)["model_cfg"]).state_dict(), path)


def measure_sam2(path: Path) -> Iterator[str]:
    """Rows of SAM2: loading, a picture encoded, a point asked for."""
    sam2, seconds = timed(lambda: load_sam2(SAM2, str(path), "cpu", "float32"))
    model, predictor = sam2.video_predictor, sam2.image_predictor()
    yield row("loading", [seconds], path, f"SAM2 {SAM2}", model)
    picture = np.random.default_rng(0).integers(0, 256, (*FRAME, 3), dtype=np.uint8)
    with sam2.compute.inference():
        seconds = [timed(lambda: predictor.set_image(picture))[1] for _ in range(2)]
        yield row(f"a picture, resized to {model.image_size}x{model.image_size}", seconds, path)
        asked = [timed(lambda: predictor.predict(*POINT)) for _ in range(2)]
    yield row("a point in it", [seconds for _, seconds in asked], path)
    check(asked[0][0][0].shape == (3, *FRAME), "the masks are not of the picture's size")
    check_equal(model, torch.load(path, weights_only=True)["model"])


def measure_clip(path: Path) -> Iterator[str]:
    """Rows of OpenCLIP: loading, a picture encoded, a text encoded."""
    clip, seconds = timed(lambda: load_open_clip(CLIP, str(path), "cpu", "float32"))
    yield row("loading", [seconds], path, f"OpenCLIP {CLIP}", clip.model)
    picture = torch.rand(1, 3, *clip.preprocessing.image_size)
    calls = {
        f"a picture of {'x'.join(map(str, picture.shape[2:]))}": lambda: clip.model.encode_image(picture),
        "a text": lambda: clip.model.encode_text(clip.tokenizer(["a red chair"])),
    }
    for what, call in calls.items():
        with clip.compute.inference():
            encoded = [timed(call) for _ in range(2)]
        yield row(what, [seconds for _, seconds in encoded], path)
        check(encoded[0][0].shape == (1, 512), "the features are not of 512 dimensions")
    check_equal(clip.model, torch.load(path, weights_only=True))


MODELS: dict[str, tuple[Callable[[Path], None], Callable[[Path], Iterator[str]]]] = {
    "sam2": (save_sam2, measure_sam2),
    "clip": (save_clip, measure_clip),
}


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call gives, and the processor time of all threads that it takes [s]."""
    start = time.process_time()
    return call(), time.process_time() - start


def row(what: str, seconds: list[float], path: Path, name: str = "", model: nn.Module | None = None) -> str:
    """One row of the table, with the process's peak memory until now."""
    weights = f"{sum(weight.numel() for weight in model.parameters()) / 1e6:.1f}" if model else ""
    size = f"{path.stat().st_size / MIB:.0f}" if model else ""
    times = [f"{value:.2f}" for value in seconds] + [""] * (2 - len(seconds))
    peak = f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f}"
    return "| " + " | ".join([name, weights, size, what, *times, peak]) + " |"


def check_equal(model: nn.Module, saved: dict[str, Tensor]) -> None:
    """Check that a model holds what was saved, to the last bit."""
    loaded = model.state_dict()
    same = loaded.keys() == saved.keys() and all(torch.equal(loaded[name], saved[name]) for name in saved)
    check(same, "the loaded weights are not the saved ones")


def check(holds: bool, otherwise: str) -> None:
    """End the bench where it would report something else than it says."""
    if not holds:
        raise RuntimeError(otherwise)


def title() -> str:
    """What the table is, and of which machine."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    threads = torch.get_num_threads()
    machine = f"{threads} thread{'s' if threads > 1 else ''} of {next(names, platform.machine())}"
    return (
        "The architectures of the published checkpoints, with random weights, saved, loaded back by path (equal to the "
        "last bit) and shown one frame: `benchmarks/published_models.py`, float32. Processor time on "
        f"{machine}; Python {platform.python_version()}, torch {torch.__version__}.\n"
    )


@click.command(help=__doc__)
@click.option("--save", type=(click.Choice(list(MODELS)), click.Path(path_type=Path)), hidden=True)
@click.option("--measure", type=(click.Choice(list(MODELS)), click.Path(path_type=Path)), hidden=True)
def main(save: tuple[str, Path] | None, measure: tuple[str, Path] | None) -> None:
    if save:
        MODELS[save[0]][0](save[1])
    elif measure:
        for line in MODELS[measure[0]][1](measure[1]):
            click.echo(line)
    else:
        click.echo(f"{title()}\n{HEADER}")
        with tempfile.TemporaryDirectory() as folder:
            for name in MODELS:
                run_again("--save", name, f"{folder}/{name}.pt")
                click.echo(run_again("--measure", name, f"{folder}/{name}.pt"), nl=False)


def run_again(*arguments: str) -> str:
    """What this script prints in a process of its own."""
    command = [sys.executable, __file__, *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    main()
