"""From the fitted laws to a sequence at the paper's settings, and to all of them on a cluster."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import yaml

from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import leaves_frames_out, masks_by_survey
from growth_bench.assumptions import Assumptions
from growth_bench.fitting import Fit, Term
from growth_bench.laws import CPU, DISK, LAWS, MEMORY, ONCE
from growth_bench.readings import Sizes
from growth_bench.scene import ROOT

CHANNELS = 512
"""Of ViT-B-16's features."""

LEVELS = 3

SAM2_MB, CLIP_MB = 1861.0, 1922.0
"""Peak memory with the paper's models, without what is remembered (benchmarks/published_models.md) [MiB]."""

REMEMBERED_MB = 19.2
"""Of an instance that SAM2 follows at 1024 pixels: 1.2 at 256, by area (``egosplat.cluster.memory``) [MiB]."""

ABSENT_STRIDE = 3
"""``segments.absent_stride``: where it is not seen, an instance is looked for in every third frame."""

NETWORK, RASTERIZER = "network_speedup", "rasterizer_speedup"
ON_GPU = {
    "segments": NETWORK,
    "view_features": NETWORK,
    "transient": RASTERIZER,
    "splats": RASTERIZER,
    "language": RASTERIZER,
    "metrics": RASTERIZER,
}
"""The stages that use a GPU, and the assumption that tells by how much it is faster."""


@dataclass(frozen=True)
class Extent:
    """What a law says, and the least and the most that laws say which lack one point each."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Cost:
    """What a stage is expected to take.

    Attributes:
        cpu_s: processor time without a GPU [s].
        memory_mb, disk_mb: peak memory and what it writes [MiB].
        gpu_s: on a GPU, as assumed [s]; None of stages that use none.
    """

    cpu_s: Extent
    memory_mb: Extent
    disk_mb: Extent
    gpu_s: float | None = None


@dataclass(frozen=True)
class Cluster:
    """All sequences on GPUs, each from its first stage to its last on one of them.

    Attributes:
        cpu_s, gpu_s: of all of them together; disk_mb: that they fill.
        rounds: sequences that one GPU works off; wall_s: until the last one ends, if nothing waits.
    """

    cpu_s: float
    gpu_s: float
    disk_mb: float
    rounds: int
    wall_s: float


def paper_config() -> Config:
    """The defaults with the preset ``paper`` over them."""
    preset = yaml.safe_load((ROOT / "config/presets/paper.yaml").read_text())
    return configuration.merge(configuration.defaults(), preset)


def paper_sizes(assumed: Assumptions) -> Sizes:
    """Sizes of a sequence at the paper's settings, by the names of ``readings.sizes_of``."""
    config = paper_config()
    splats, initial = config["splats"], config["transient"]
    pixels, training = config["frames"]["resolution"] ** 2, assumed.frames - assumed.evaluated
    codes = LEVELS * config["features"]["dims"]
    return {
        "frames": assumed.frames,
        "kept": assumed.frames,
        "training": training,
        "evaluated": assumed.evaluated,
        "pixels": pixels,
        "recorded_pixels": pixels,
        "points": assumed.points,
        "instances": assumed.instances,
        "followed": assumed.instances,
        "prompts": config["segments"]["points_per_side"] ** 2,
        "views": assumed.instances * assumed.visible * training,
        "channels": CHANNELS,
        "codes": codes,
        "joint": codes if splats["language"] == "joint" else 0,
        "autoencoder": int(config["features"]["compression"] == "autoencoder"),
        "epochs": config["features"]["epochs"],
        "initial_iterations": initial["iterations"],
        "network_iterations": initial["iterations"] - round(initial["warmup"] * initial["iterations"]),
        "initial_pixels": min(initial["resolution"] ** 2, pixels),
        "network_pixels": initial["input_size"] ** 2,
        "initial_gaussians": min(assumed.gaussians, initial["max_gaussians"]),
        "iterations": splats["iterations"],
        "gaussians": min(assumed.gaussians, splats["max_gaussians"]),
        "mean_gaussians": min(assumed.gaussians, splats["max_gaussians"]),
        "queries": assumed.queries,
    }


def with_paper_models(
    fits: Mapping[str, Mapping[str, Fit]], published: Mapping[str, float], assumed: Assumptions
) -> dict[str, dict[str, Fit]]:
    """The laws with the paper's models in place of the small ones: their own unit costs instead of fitted ones.

    Instances of the first frame are followed forwards alone, each where it is seen, else in every third frame.
    """
    looked_for = assumed.visible + (1 - assumed.visible) / ABSENT_STRIDE
    units: dict[tuple[str, str], dict[Term, float]] = {
        ("segments", CPU): {
            ("kept",): published["picture"],
            ("prompts",): published["prompt"],
            ("kept", "followed"): published["followed"] * looked_for,
        },
        ("segments", MEMORY): {ONCE: SAM2_MB, ("followed",): REMEMBERED_MB},
        ("view_features", CPU): {("views",): published["crop"]},
        ("view_features", MEMORY): {ONCE: CLIP_MB},
    }
    found = {stage: dict(laws) for stage, laws in fits.items()}
    for (stage, measure), known in units.items():
        law = found[stage][measure]
        found[stage][measure] = replace(
            law,
            coefficients={**law.coefficients, **known},
            without=tuple({**one, **known} for one in law.without),
        )
    return found


def stages_of(config: Config) -> list[str]:
    """The stages of ``laws.LAWS`` that a configuration asks for: the survey is made only where it decides something."""
    surveyed = masks_by_survey(config) or leaves_frames_out(config)
    return [stage for stage in LAWS if stage != "survey" or surveyed]


def costs_of(
    fits: Mapping[str, Mapping[str, Fit]], stages: Iterable[str], sizes: Sizes, assumed: Assumptions
) -> dict[str, Cost]:
    """What each of some stages takes of a scene of these sizes, also on a GPU."""
    found = {}
    for stage in stages:
        cpu, memory, disk = (
            Extent(law.at(sizes), *law.between(sizes))
            for law in (fits[stage][measure] for measure in (CPU, MEMORY, DISK))
        )
        speedup = getattr(assumed, ON_GPU[stage]) if stage in ON_GPU else None
        found[stage] = Cost(cpu, memory, disk, cpu.value / speedup if speedup else None)
    return found


def on_cluster(costs: Mapping[str, Cost], assumed: Assumptions) -> Cluster:
    """All sequences, with one core beside each GPU for the stages that use none."""
    gpu_s = sum(cost.gpu_s for cost in costs.values() if cost.gpu_s is not None)
    beside = sum(cost.cpu_s.value for cost in costs.values() if cost.gpu_s is None)
    rounds = math.ceil(assumed.sequences / assumed.gpus)
    return Cluster(
        cpu_s=assumed.sequences * sum(cost.cpu_s.value for cost in costs.values()),
        gpu_s=assumed.sequences * gpu_s,
        disk_mb=assumed.sequences * sum(cost.disk_mb.value for cost in costs.values()),
        rounds=rounds,
        wall_s=rounds * (gpu_s + beside),
    )
