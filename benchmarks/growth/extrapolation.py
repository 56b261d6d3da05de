"""Extrapolate the fitted laws to one sequence at the paper's settings, and to all sequences on a cluster."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.fitting import Fit
from benchmarks.growth.laws import LAWS
from benchmarks.growth.readings import Sizes
from benchmarks.growth.scene import ROOT
from egosplat.cost_model.laws import CPU, DISK, MEMORY
from egosplat.cost_model.sizes import Sizes as SceneSizes
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import leaves_frames_out, survey_decides

NETWORK, RASTERIZER = "network_speedup", "rasterizer_speedup"
# The assumption with the speed-up of each stage that uses a GPU.
ON_GPU = {
    "segments": NETWORK,
    "view_features": NETWORK,
    "transient": RASTERIZER,
    "splats": RASTERIZER,
    "language": RASTERIZER,
    "metrics": RASTERIZER,
}


@dataclass(frozen=True)
class Extent:
    """The value of a law, and the smallest and largest of the laws that are fitted without one point."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Cost:
    """The expected cost of a stage.

    Attributes:
        cpu_s: processor time without a GPU [s].
        memory_mb, disk_mb: peak memory and size of its artifact [MiB].
        gpu_s: assumed time on a GPU [s]; None for stages that use none.
    """

    cpu_s: Extent
    memory_mb: Extent
    disk_mb: Extent
    gpu_s: float | None = None


@dataclass(frozen=True)
class Cluster:
    """All sequences on GPUs, each sequence on one GPU.

    Attributes:
        cpu_s, gpu_s: sums over all sequences [s]; disk_mb: their artifacts [MiB].
        rounds: sequences of one GPU; wall_s: time until the last one ends, without waiting for a scheduler [s].
    """

    cpu_s: float
    gpu_s: float
    disk_mb: float
    rounds: int
    wall_s: float


def paper_config() -> Config:
    """The configuration of the preset ``paper``."""
    return configuration.resolve({"preset": "paper"}, ROOT / "config/presets")


def paper_sizes(assumed: Assumptions) -> Sizes:
    """The sizes in the laws for a sequence at the paper's settings, by name."""
    config = paper_config()
    training = assumed.frames - assumed.evaluated
    given = {
        "frames": assumed.frames,
        "training": training,
        "evaluated": assumed.evaluated,
        "pixels": config["frames"]["resolution"] ** 2,
        "points": assumed.points,
        "instances": assumed.instances,
        "tracked": assumed.instances,
        "prompts": config["segments"]["points_per_side"] ** 2,  # the preset prompts only the first frame
        "views": assumed.instances * assumed.visible * training,
        "initial_gaussians": min(assumed.gaussians, config["transient"]["max_gaussians"]),
        "gaussians": min(assumed.gaussians, config["splats"]["max_gaussians"]),
        "queries": assumed.queries,
    }
    sizes = SceneSizes(config, given=given)
    names = (name for laws in LAWS.values() for terms in laws.values() for term in terms for name in term)
    return {name: sizes[name] for name in dict.fromkeys(names)}


def stages_of(config: Config) -> list[str]:
    """The stages of ``laws.LAWS`` that a configuration needs; the survey only if it decides something."""
    surveyed = survey_decides(config) or leaves_frames_out(config)
    return [stage for stage in LAWS if stage != "survey" or surveyed]


def costs_of(
    fits: Mapping[str, Mapping[str, Fit]], stages: Iterable[str], sizes: Sizes, assumed: Assumptions
) -> dict[str, Cost]:
    """The cost of each stage for a scene of these sizes, also on a GPU."""
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
    """All sequences, with one core for each GPU that runs the stages without GPU."""
    gpu_s = sum(cost.gpu_s for cost in costs.values() if cost.gpu_s is not None)
    without_gpu_s = sum(cost.cpu_s.value for cost in costs.values() if cost.gpu_s is None)
    rounds = math.ceil(assumed.sequences / assumed.gpus)
    return Cluster(
        cpu_s=assumed.sequences * sum(cost.cpu_s.value for cost in costs.values()),
        gpu_s=assumed.sequences * gpu_s,
        disk_mb=assumed.sequences * sum(cost.disk_mb.value for cost in costs.values()),
        rounds=rounds,
        wall_s=rounds * (gpu_s + without_gpu_s),
    )
