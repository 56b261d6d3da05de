"""GPU memory of the preset paper at 1408 px: every stage on a short recording, and training by the number of Gaussians."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
import yaml

from benchmarks.common import MIB, ROOT, markdown
from benchmarks.gpu.main_job import SCENE, cells_of, make, records_of
from benchmarks.published_models.weights import CLIP, SAM2, save_clip, save_sam2
from egosplat.artifacts.reader import open_any
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.gaussians.model import Gaussians
from egosplat.pipeline.config import resolve, stage_values
from egosplat.progress import log
from egosplat.splats import stage as splats
from egosplat.transient import stage as transient
from egosplat_rivals.scored_scenes import read_scored_scene

GIB = 2**30

# Memory of the cards that the paper's authors name.
CARD_GIB = 24

# Times do not matter here. Every mask is kept and tracked in every frame, but with random weights most of SAM2's are alike.
SHORT: dict[str, Any] = {
    "preset": "paper",
    "models": {
        "sam2_config": SAM2,
        "sam2_checkpoint": "sam2.pt",
        "clip_model": CLIP,
        "clip_checkpoint": "clip.pt",
    },
    "synthetic": {"size": 1408, "fps": 0.5, "seconds": 24.0},
    "segments": {
        "min_area": 0.0,
        "prompting": "initial_frame",
        "merge_iou": 1.0,
        "min_frames": 1,
        "lost_track_stride": 1,
    },
    "transient": {"iterations": 700, "encoder_weights": None},
    "view_features": {"max_views": 1},
    "features": {"epochs": 2},
    "splats": {"iterations": 300},
    "language": {"iterations": 300},
}

# Numbers of Gaussians that the stages are trained with, and for how many iterations.
COUNTS = (1_000_000, 2_000_000, 4_000_000)
ITERATIONS = 40

# Distance of a copy from its Gaussian, in its own sizes.
_JITTER = 2.0


@dataclass(frozen=True)
class Trained:
    """Memory of one training.

    Attributes:
        gaussians: at the end.
        held, reserved: peak of the tensors, and of what PyTorch took from the card for them [bytes].
    """

    gaussians: int
    held: int
    reserved: int


def run(folder: Path) -> None:
    """Run every stage once.

    Raises:
        UserError: a job failed; Snakemake has said why.
    """
    (folder / "config").mkdir(parents=True, exist_ok=True)
    for path, save in ((folder / "sam2.pt", save_sam2), (folder / "clip.pt", save_clip)):
        if not path.exists():
            save(path)
    (folder / "config/config.yaml").write_text(yaml.safe_dump(SHORT))
    (folder / "config/scenes.tsv").write_text((ROOT / "config/scenes.tsv").read_text())
    make(folder, [SCENE / "metrics.json"])


def stages(folder: Path) -> str:
    """A row for each stage: its time on the clock, and the peaks of main and GPU memory."""
    records = records_of(read_scored_scene(folder / SCENE / "metrics.json"))
    header = ["stage", "time [s]", "memory [GiB]", "GPU [GiB]"]
    return markdown(header, [[stage, *cells_of(record)] for stage, record in records.items()])


def training(scene: Path, work: Path) -> str:
    """A row for each stage and number of Gaussians, and the law of each stage between the first and the last.

    Args:
        scene: folder with the artifacts that the stages read.
        work: folder for what they write.
    """
    rows, laws = [], []
    for name in STAGES:
        found = list(trained(name, scene, work))
        rows += [
            [name, f"{one.gaussians:,}", f"{one.held / GIB:.1f}", f"{one.reserved / GIB:.1f}"]
            for one in found
        ]
        laws.append(_law(name, found[0], found[-1]))
    table = markdown(["stage", "Gaussians", "GPU [GiB]", "reserved [GiB]"], rows)
    return "\n\n".join([table, *laws])


def _law(name: str, least: Trained, most: Trained) -> str:
    each = (most.held - least.held) / (most.gaussians - least.gaussians)
    fixed, limit = least.held - each * least.gaussians, keys_of(name)["max_gaussians"]
    return (
        f"`{name}`: {each / 1e3:.2f} kB a Gaussian and {fixed / MIB:.0f} MiB: {(fixed + each * limit) / GIB:.1f} GiB at the "
        f"limit of {limit:,} Gaussians, of {CARD_GIB} GiB."
    )


def keys_of(stage: str) -> dict[str, Any]:
    """Keys of a stage."""
    return stage_values(stage, resolve(SHORT, ROOT / "config/presets"))


def _train_transient(scene: Path, output: Path) -> None:
    keys = keys_of("transient") | {"iterations": ITERATIONS}
    options = transient.TransientOptions(**keys)
    transient.run(scene / "frames.zarr", scene / "poses.zarr", output, options)


def _train_splats(scene: Path, output: Path) -> None:
    keys = keys_of("splats") | {"iterations": ITERATIONS}
    paths = {f"{kind}_path": scene / f"{kind}.zarr" for kind in ("masks", "instances", "features")}
    splats.run(scene / "frames.zarr", scene / "poses.zarr", output, splats.SplatsOptions(**keys), **paths)


STAGES = {"transient": (transient, _train_transient), "splats": (splats, _train_splats)}


def trained(name: str, scene: Path, work: Path) -> Iterator[Trained]:
    """Train a stage from so many copies of the Gaussians that it starts with."""
    module, train = STAGES[name]
    given = module.starting_gaussians
    for count in COUNTS:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()
        module.starting_gaussians = lambda *some, _count=count, **named: copies(given(*some, **named), _count)
        output = work / f"{name}_{count}.zarr"
        try:
            train(scene, output)
        finally:
            module.starting_gaussians = given
        gaussians = open_any(output, SCHEMAS).facts.get("gaussians", count)
        found = Trained(gaussians, torch.cuda.max_memory_allocated(), torch.cuda.max_memory_reserved())
        log(f"{name}: {found}")
        yield found


def copies(some: Gaussians, count: int) -> Gaussians:
    """So many Gaussians around the given ones, each as much smaller as there are more of them."""
    noise = torch.Generator().manual_seed(0)
    more = some.select(torch.arange(count, device=some.means.device) % some.count)
    factor = (some.count / count) ** 0.5
    offsets = torch.randn(count, 3, generator=noise).to(some.means) * more.scales * _JITTER
    return replace(more, means=more.means + offsets, log_scales=more.log_scales + math.log(factor))
