"""Cost of the published architectures: loading, one frame, memory.

    OMP_NUM_THREADS=1 python -m benchmarks.published_models > benchmarks/published_models/README.md

Builds SAM2.1 hiera_b+ and OpenCLIP ViT-B-16 with random weights, saves them as the published files are, loads them by path and
runs one frame. The loaded weights must equal the saved ones. Times do not depend on the values of the weights. Each model runs
in a process of its own, so that peak memory is its own.
"""

import json
import platform
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.common import MIB, command, markdown, output_of, time_call
from benchmarks.published_models.weights import CLIP, SAM2, save_clip, save_sam2
from benchmarks.small_sam2.segmenters import image_predictor
from egosplat.artifacts.provenance import machine, peak_memory_mb
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.models.sam2_loader import load_sam2

FRAME = (512, 512)
POINT = np.array([[256.0, 256.0]]), np.array([1])

COLUMNS = [
    "model",
    "what",
    "million weights",
    "file [MiB]",
    "first [CPU-s]",
    "again [CPU-s]",
    "peak memory [MiB]",
]

Rows = Iterator[list[str]]


def measure_sam2(path: Path, architecture: str) -> Rows:
    """Rows of SAM2: loading, encoding an image, a point prompt."""
    sam2, seconds = time_call(lambda: load_sam2(architecture, str(path), "cpu", "float32"))
    model, predictor = sam2.video_predictor, image_predictor(sam2)
    yield row("loading", [seconds], path, f"SAM2 {architecture}", model)
    image = np.random.default_rng(0).integers(0, 256, (*FRAME, 3), dtype=np.uint8)
    with sam2.compute.inference():
        seconds = [time_call(predictor.set_image, image)[1] for _ in range(2)]
        yield row(f"an image, resized to {model.image_size}x{model.image_size}", seconds, path)
        asked = [time_call(predictor.predict, *POINT) for _ in range(2)]
    yield row("a point in it", [seconds for _, seconds in asked], path)
    check(asked[0][0][0].shape == (3, *FRAME), "the masks do not have the image's size")
    check_equal(model, torch.load(path, weights_only=True)["model"])


def measure_clip(path: Path, architecture: str) -> Rows:
    """Rows of OpenCLIP: loading, encoding an image, encoding a text."""
    clip, seconds = time_call(lambda: load_open_clip(architecture, str(path), "cpu", "float32"))
    yield row("loading", [seconds], path, f"OpenCLIP {architecture}", clip.model)
    image = torch.rand(1, 3, *clip.preprocessing.image_size)
    calls: dict[str, Callable[[], Tensor]] = {
        f"an image of {'x'.join(map(str, image.shape[2:]))}": lambda: clip.model.encode_image(image),
        "a text": lambda: clip.model.encode_text(clip.tokenizer(["a red chair"])),
    }
    shapes = set()
    for what, call in calls.items():
        with clip.compute.inference():
            encoded = [time_call(call) for _ in range(2)]
        yield row(what, [seconds for _, seconds in encoded], path)
        shapes.add(encoded[0][0].shape)
    check(len(shapes) == 1, "features of image and text differ in shape")
    check_equal(clip.model, torch.load(path, weights_only=True))


MODELS = {"sam2": (save_sam2, measure_sam2), "clip": (save_clip, measure_clip)}


def row(
    what: str, seconds: list[float], path: Path, name: str = "", model: nn.Module | None = None
) -> list[str]:
    """A row of the table, with the process's peak memory so far."""
    weights = f"{sum(weight.numel() for weight in model.parameters()) / 1e6:.1f}" if model else ""
    size = f"{path.stat().st_size / MIB:.0f}" if model else ""
    times = [f"{value:.2f}" for value in seconds] + [""] * (2 - len(seconds))
    return [name, what, weights, size, *times, f"{peak_memory_mb():.0f}"]


def check_equal(model: nn.Module, saved: dict[str, Tensor]) -> None:
    """Check that a model holds the saved weights, to the last bit."""
    loaded = model.state_dict()
    same = loaded.keys() == saved.keys() and all(torch.equal(loaded[name], saved[name]) for name in saved)
    check(same, "the loaded weights are not the saved ones")


def check(holds: bool, otherwise: str) -> None:
    """Stop rather than report something untrue."""
    if not holds:
        raise RuntimeError(otherwise)


@command(__doc__)
@click.option("--sam2", default=SAM2, show_default=True, help="Architecture, as models.sam2_config.")
@click.option("--clip", default=CLIP, show_default=True, help="Architecture, as models.clip_model.")
@click.option("--measure", type=(click.Choice(list(MODELS)), click.Path(path_type=Path)), hidden=True)
def main(sam2: str, clip: str, measure: tuple[str, Path] | None) -> None:
    """Print the table; with the hidden option, measure one model in this process."""
    architectures = {"sam2": sam2, "clip": clip}
    if measure:
        click.echo(json.dumps(list(MODELS[measure[0]][1](measure[1], architectures[measure[0]]))))
        return
    chosen = ("--sam2", sam2, "--clip", clip)
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in MODELS:
            path = Path(folder) / f"{name}.pt"
            MODELS[name][0](path, architectures[name])
            rows += json.loads(output_of("benchmarks.published_models", *chosen, "--measure", name, path))
    click.echo(
        "# The published architectures\n\nWith random weights, saved, loaded by path (equal to the last bit), one frame: "
        f"`python -m benchmarks.published_models`, float32. Processor time on {machine()}, "
        f"{torch.get_num_threads()} threads; Python {platform.python_version()}, torch {torch.__version__}.\n"
    )
    click.echo(markdown(COLUMNS, rows, words=2))


if __name__ == "__main__":
    main()
