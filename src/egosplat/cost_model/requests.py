"""Memory, time and GPUs that a job requests from a scheduler: expected cost, times a margin, times the attempt."""

import math
from collections.abc import Iterable

from egosplat.cost_model.laws import gpu_seconds, law_of, memory_mib, seconds
from egosplat.cost_model.sizes import UNKNOWN_FRAMES, Sizes, merges_masks
from egosplat.pipeline.config import Config, stage_values

# Factor of the expected memory. On the largest finished scene outside of the fit, stages took up to 1.1 times
# that.
MEMORY_MARGIN = 1.3

# Memory of the two Snakemake processes of a job: one submits it, one runs its command [MB].
SNAKEMAKE_MB = 700.0

# CUDA's libraries and context in a process that uses a GPU [MB]. Assumed.
CUDA_MB = 3000.0

# Factor of the expected time, for slower machines and busy file systems. A job that ends earlier costs
# nothing.
TIME_MARGIN = 3.0

# Python starts slowly from a network file system. A stage that is stopped after a day resumes from its
# checkpoint.
LEAST_S, MOST_S = 600.0, 86_400.0

# Factor of the time on a GPU, whose speed is assumed.
GPU_MARGIN = 4.0

_ON_GPU = {"auto", "cuda"}


def memory_mb(stage: str, config: Config, inputs: Iterable[str], attempt: int) -> int:
    """Memory to request, a multiple of 100 [MB].

    Args:
        stage: one of ``STAGES``.
        inputs: paths of the job's inputs.
        attempt: from 1; attempt n requests n times as much.

    Raises:
        FileNotFoundError, LookupError: see ``Sizes``.
    """
    sizes = _sizes(stage, config, inputs, at_most=True)
    stage_mb = memory_mib(_law(stage, config, sizes), sizes) * 2**20 / 1e6
    cuda_mb = CUDA_MB if gpus(stage, config) else 0.0
    return attempt * 100 * math.ceil((SNAKEMAKE_MB + MEMORY_MARGIN * (stage_mb + cuda_mb)) / 100)


def runtime_min(stage: str, config: Config, inputs: Iterable[str], attempt: int) -> int:
    """Time to request, in whole minutes, a day at most; arguments and errors as for ``memory_mb``."""
    sizes = _sizes(stage, config, inputs, at_most=False)
    law = _law(stage, config, sizes)
    if law in ("segments_published", "view_features_published") and gpus(stage, config):
        expected = GPU_MARGIN * gpu_seconds(law, sizes)
    else:
        # Too long for a node with a GPU or AVX, but right for one without.
        expected = seconds(law, sizes, "generic")
    return attempt * math.ceil(min(LEAST_S + TIME_MARGIN * expected, MOST_S) / 60)


def gpus(stage: str, config: Config) -> int:
    """GPUs that a job of the stage can use: 1 if a key lets models or rendering run on one, else 0."""
    if stage == "segments" and config["segments"]["segmenter"] == "classical":
        return 0
    # Tracks are copied as they are.
    if stage == "instances" and not merges_masks(config):
        return 0
    values = stage_values(stage, config)
    return int(any(values.get(key) in _ON_GPU for key in ("device", "backend")))


def _sizes(stage: str, config: Config, inputs: Iterable[str], at_most: bool) -> Sizes:
    # The job that reads a recording has no input with its length.
    unread = {"frames": UNKNOWN_FRAMES, "pixels": config["frames"]["resolution"] ** 2}
    return Sizes(config, inputs, unread if stage == "frames" else None, at_most)


def _law(stage: str, config: Config, sizes: Sizes) -> str:
    return law_of(stage, config, colmap=stage == "poses" and sizes.colmap)
