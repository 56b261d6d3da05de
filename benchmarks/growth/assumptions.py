"""Assumptions of the extrapolation: quantities that were not measured. Each is an option of the command line."""

from dataclasses import dataclass, field
from typing import Any


def _assumed(default: float, about: str) -> Any:
    return field(default=default, metadata={"about": about})


@dataclass(frozen=True)
class Assumptions:
    """Assumptions about a sequence and a cluster; ``about`` is the help text of the option."""

    frames: int = _assumed(3600, "Frames of a sequence; two minutes at ADT's 30 per second.")
    instances: int = _assumed(300, "Instances that SAM2 tracks in a sequence, all levels together.")
    visible: float = _assumed(0.3, "Share of the frames in which an instance is visible, 0 to 1.")
    gaussians: int = _assumed(1_000_000, "Gaussians of a scene, on average over its training.")
    points: int = _assumed(1_000_000, "Points of a sequence's semi-dense cloud after filtering.")
    evaluated: int = _assumed(12, "Frames that the benchmark scores.")
    queries: int = _assumed(150, "Queries: pairs of a category and a frame.")
    network_speedup: float = _assumed(
        200.0, "Speed of a GPU relative to one core for SAM2, OpenCLIP and the transient network."
    )
    rasterizer_speedup: float = _assumed(
        50.0, "Speed of a GPU relative to one core for rendering and training Gaussians."
    )
    sequences: int = _assumed(236, "Sequences; ADT has 236.")
    gpus: int = _assumed(64, "GPUs of the cluster, each with at least one core.")
