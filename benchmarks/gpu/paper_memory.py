"""GPU memory of the preset paper at 1408 px: every stage on a short recording, and training by the number of Gaussians."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
import yaml

from benchmarks.common import MIB, ROOT, markdown
from benchmarks.gpu.main_job import SCENE, cells_of, make, records_of
from benchmarks.published_models.weights import CLIP, SAM2, save_clip, save_sam2
from benchmarks.segments_growth.__main__ import KEEP_ALL
from egosplat.gaussians.model import Gaussians
from egosplat.pipeline.config import resolve, stage_values
from egosplat.splats import stage as splats
from egosplat.tables.scored_scenes import read_scored_scene

GIB = 2**30

# Memory of the cards that the paper's authors name.
CARD_GIB = 24

# Times do not matter here. With random weights SAM2's masks are noise: all are kept, up to the preset's number of instances.
SHORT: dict[str, Any] = {
    "preset": "paper",
    "models": {
        "sam2_config": SAM2,
        "sam2_checkpoint": "sam2.pt",
        "clip_model": CLIP,
        "clip_checkpoint": "clip.pt",
    },
    "synthetic": {"size": 1408, "fps": 0.5, "seconds": 24.0},
    "segments": {key: value for key, value in KEEP_ALL.items() if key not in ("points_per_side", "batch")}
    | dict.fromkeys(("pred_iou_thresh", "stability_score_thresh", "nms_score_thresh"), 0.0),
    "transient": {"iterations": 700, "encoder_weights": None},
    "view_features": {"max_views": 1},
    "features": {"epochs": 2},
    "splats": {"iterations": 300},
    "language": {"iterations": 300},
}

# Numbers of Gaussians that the stage splats is trained with.
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


def training(folder: Path) -> str:
    """A row for each number of Gaussians, and the law between the first and the last."""
    found = list(_trained(folder))
    rows = [[f"{one.gaussians:,}", f"{one.held / GIB:.1f}", f"{one.reserved / GIB:.1f}"] for one in found]
    least, most = found[0], found[-1]
    each = (most.held - least.held) / (most.gaussians - least.gaussians)
    fixed = least.held - each * least.gaussians
    limit = _keys()["max_gaussians"]
    whole = (fixed + each * limit) / GIB
    return (
        f"{markdown(['Gaussians', 'GPU [GiB]', 'reserved [GiB]'], rows, words=0)}\n\n"
        f"{each / 1e3:.2f} kB a Gaussian and {fixed / MIB:.0f} MiB: {whole:.1f} GiB at the limit of {limit:,} Gaussians, "
        f"of {CARD_GIB} GiB."
    )


def _keys() -> dict[str, Any]:
    """Keys of the stage splats."""
    return stage_values("splats", resolve(SHORT, ROOT / "config/presets"))


def _trained(folder: Path) -> Iterator[Trained]:
    """Train the stage splats of the short run again, from copies of its Gaussians."""
    scene, given = folder / SCENE, splats.starting_gaussians
    keys = _keys() | {"iterations": ITERATIONS, "checkpoint_s": 1e9}
    kinds = ("masks", "instances", "features")
    for count in COUNTS:
        began = time.perf_counter()
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()
        splats.starting_gaussians = lambda *some, _count=count, **named: copies(given(*some, **named), _count)
        try:
            output = folder / f"splats_{count}.zarr"
            options = splats.SplatsOptions(**keys)
            paths = {f"{kind}_path": scene / f"{kind}.zarr" for kind in kinds}
            splats.run(scene / "frames.zarr", scene / "poses.zarr", output, options, **paths)
        finally:
            splats.starting_gaussians = given
        held, reserved = torch.cuda.max_memory_allocated(), torch.cuda.max_memory_reserved()
        curve = splats.open_artifact(output, splats.SPLATS).read("curve/gaussians")
        print(
            f"{count}: {curve.max()} Gaussians, {held}, {reserved}, {time.perf_counter() - began:.1f} s",
            flush=True,
        )
        yield Trained(int(curve.max()), held, reserved)


def copies(some: Gaussians, count: int) -> Gaussians:
    """So many Gaussians around the given ones, each as much smaller as there are more of them."""
    noise = torch.Generator().manual_seed(0)
    more = some.select(torch.arange(count, device=some.means.device) % some.count)
    factor = (some.count / count) ** 0.5
    offsets = torch.randn(count, 3, generator=noise).to(some.means) * more.scales * _JITTER
    return replace(more, means=more.means + offsets, log_scales=more.log_scales + torch.tensor(factor).log())
