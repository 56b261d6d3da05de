"""What a job of a stage asks a scheduler for: the laws, with room above them, and more at each further attempt."""

import math

from egosplat.cluster.memory import peak_mb
from egosplat.cluster.runtime import expected_s
from egosplat.cluster.shapes import Shapes
from egosplat.pipeline.config import Config, stage_values

ROOM = 1.3
"""Times the law: 30 % are for what it does not know."""

BESIDE_MB = 700.0
"""Beside the stage's process: two Snakemakes, of which one submits and one runs the job's command."""

ON_GPU_MB = 3000.0
"""CUDA's libraries and context in a process that uses a GPU. Assumed."""

_ON_GPU = {"auto", "cuda"}


def memory_mb(stage: str, config: Config, shapes: Shapes, attempt: int) -> int:
    """Memory to ask for, in whole hundreds [MB].

    Args:
        stage, config, shapes: see ``egosplat.cluster.memory.peak_mb``, also for what is raised.
        attempt: 1 at first; the n-th asks for n times as much.
    """
    own = peak_mb(stage, config, shapes) + (ON_GPU_MB if gpus(stage, config) else 0.0)
    return attempt * 100 * math.ceil((BESIDE_MB + ROOM * own) / 100)


def runtime_min(stage: str, config: Config, shapes: Shapes, attempt: int) -> int:
    """Time to ask for, in whole minutes; arguments as ``memory_mb``."""
    return attempt * math.ceil(expected_s(stage, config, shapes) / 60)


def gpus(stage: str, config: Config) -> int:
    """GPUs that a job of the stage can use: 1 where a key of it lets models or rendering run on one, else 0."""
    if stage == "segments" and config["segments"]["segmenter"] == "classical":
        return 0
    values = stage_values(stage, config)
    return int(any(values.get(key) in _ON_GPU for key in ("device", "backend")))
