"""Memory, time and GPUs that a stage's job requests: a base and a slope over the gigapixels of the frames, times the attempt."""

import errno
import json
import math
from collections.abc import Iterable
from pathlib import Path

from egosplat.pipeline.chunks import CHUNK_FRAMES
from egosplat.pipeline.config import Config, stage_sections, stage_values
from egosplat.pipeline.dag import merges_masks
from egosplat.pipeline.stages import STAGES

# Frames of a recording that is not read yet: two minutes of 30 frames per second.
UNREAD_FRAMES = 3600

# CUDA's libraries in the main memory of a job that uses a GPU [MB] (assumed).
_CUDA_MB = 4000

# Models that were measured without a GPU take a multiple of the bundled ones' memory and time.
_SMALL, _PUBLISHED_MB, _PUBLISHED_TIMES = "small", 3000, 10

# A stage that is stopped after a day resumes from its checkpoint [min].
_DAY_MIN = 1440


def gigapixels(stage: str, config: Config, inputs: Iterable[str], chunk: bool = False) -> float:
    """Count the pixels of the frames that a job reads: of frames.zarr, if it is an input, else of the recording to come.

    Args:
        inputs: paths of the job's inputs.
        chunk: whether the job works on a chunk of the frames alone.

    Raises:
        FileNotFoundError: frames.zarr is an input and is not made yet; ``filename`` is its path.
    """
    if stage == "synthetic":
        film = config["synthetic"]
        return film["seconds"] * film["fps"] * film["size"] ** 2 / 1e9
    read = next((Path(path) for path in inputs if Path(path).name == "frames.zarr"), None)
    if read is None:
        return UNREAD_FRAMES * config["frames"]["resolution"] ** 2 / 1e9 if stage == "frames" else 0.0
    try:
        frames, height, width, _ = json.loads((read / "rgb" / "zarr.json").read_text())["shape"]
    except OSError:
        raise FileNotFoundError(errno.ENOENT, "is still to be made", str(read)) from None
    return (min(frames, CHUNK_FRAMES) if chunk else frames) * height * width / 1e9


def memory_mb(stage: str, config: Config, inputs: Iterable[str], attempt: int, chunk: bool = False) -> int:
    """Memory to request, a multiple of 100 [MB]; attempt n, from 1, requests n times as much. Raises as ``gigapixels``."""
    base, slope = STAGES[stage].memory
    more = _CUDA_MB * gpus(stage, config) + _PUBLISHED_MB * _is_published(stage, config)
    needed = base + slope * gigapixels(stage, config, inputs, chunk) + more
    return attempt * 100 * math.ceil(needed / 100)


def runtime_min(stage: str, config: Config, inputs: Iterable[str], attempt: int, chunk: bool = False) -> int:
    """Time to request, in whole minutes, a day at most for each attempt; arguments and errors as for ``memory_mb``."""
    base, slope = STAGES[stage].minutes
    factor = _PUBLISHED_TIMES if _is_published(stage, config) and not gpus(stage, config) else 1
    needed = base + factor * slope * gigapixels(stage, config, inputs, chunk)
    return attempt * math.ceil(min(needed, _DAY_MIN))


def can_use_gpu(stage: str) -> bool:
    """Whether a stage has a key that lets models or rendering run on a GPU."""
    return any({"device", "backend"} & {*keys} for keys in stage_sections(stage).values())


def gpus(stage: str, config: Config) -> int:
    """GPUs that a job of the stage can use: 1 if a key lets models or rendering run on one, else 0."""
    if stage == "segments" and config["segments"]["segmenter"] == "classical":
        return 0
    # Tracks are copied as they are.
    if stage == "instances" and not merges_masks(config):
        return 0
    values = stage_values(stage, config)
    return int(any(values.get(key) in ("auto", "cuda") for key in ("device", "backend")))


def _is_published(stage: str, config: Config) -> bool:
    values = stage_values(stage, config)
    return any(values.get(key, _SMALL) != _SMALL for key in ("sam2_config", "clip_model"))
