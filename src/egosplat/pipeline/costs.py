"""Memory, time and GPUs that a stage's job requests: a base and a slope over the gigapixels of the frames, times the attempt."""

import contextlib
import errno
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from egosplat.pipeline.chunks import CHUNK_FRAMES
from egosplat.pipeline.config import Config, stage_sections, stage_values
from egosplat.pipeline.dag import merges_masks
from egosplat.pipeline.stages import STAGES

# Frames of a recording that is not read yet: two minutes of 30 frames per second.
UNREAD_FRAMES = 3600

# CUDA's libraries in the main memory of a job that uses a GPU (assumed), and what other models than the bundled ones take more
# [MB]; without a GPU they take a multiple of the time.
_CUDA_MB, _PUBLISHED_MB, _PUBLISHED_TIMES = 4000, 3000, 10

# A stage that is stopped after a day resumes from its checkpoint [min].
_DAY_MIN = 1440


def gigapixels(stage: str, config: Config, inputs: Iterable[str], chunk: bool = False) -> float:
    """Count the pixels of the frames among a job's inputs, or of the recording to come; of a chunk, those of
    its frames alone (FileNotFoundError: frames.zarr is an input and is not made yet; ``filename`` is its
    path)."""
    if stage == "synthetic":
        film = config["synthetic"]
        return film["seconds"] * film["fps"] * film["size"] ** 2 / 1e9
    if stage == "frames":
        return UNREAD_FRAMES * config["frames"]["resolution"] ** 2 / 1e9
    for path in inputs:
        if Path(path).name == "frames.zarr":
            header = Path(path) / "rgb" / "zarr.json"
            if not header.exists():
                raise FileNotFoundError(errno.ENOENT, "is still to be made", path)
            frames, height, width, _ = json.loads(header.read_text())["shape"]
            return (min(frames, CHUNK_FRAMES) if chunk else frames) * height * width / 1e9
    return 0.0


def request(
    stage: str, config: Config, inputs: Iterable[str], attempt: int, chunk: bool = False
) -> dict[str, int]:
    """Get what to request, attempt n, from 1, n times as much: ``mem_mb``, a multiple of 100 [MB], and ``runtime``, a day at most
    [min]. Raises as ``gigapixels``."""
    _, _, base_min, slope_min = STAGES[stage].request
    values, size = stage_values(stage, config), gigapixels(stage, config, inputs, chunk)
    devices = gpus(stage, config)
    megabytes = _megabytes(stage, values, size) + _CUDA_MB * devices
    times = _PUBLISHED_TIMES if _is_published(values) and not devices else 1
    minutes = min(base_min + times * slope_min * size, _DAY_MIN)
    return {"mem_mb": attempt * 100 * math.ceil(megabytes / 100), "runtime": attempt * math.ceil(minutes)}


def lack_of_memory(
    stage: str, values: Mapping[str, Any], frames: Path | None, chunk: bool = False
) -> str | None:
    """Say that a stage may need more memory than the machine has for its frames, and what needs less; None if it does not."""
    # The stage itself tells what is wrong with the frames.
    with contextlib.suppress(OSError, ValueError, KeyError):
        needed = _megabytes(stage, values, gigapixels(stage, {}, [str(frames)], chunk))
        has = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
        if _megabytes(stage, values, 0.0) <= has < needed:
            told = f"may need {needed / 1e3:.0f} GB of memory for these frames, and {has / 1e3:.0f} are here"
            return f"{told}: a larger frames.stride or a smaller frames.resolution needs less"
    return None


def _megabytes(stage: str, values: Mapping[str, Any], size: float) -> float:
    base, slope, *_ = STAGES[stage].request
    return base + slope * size + _PUBLISHED_MB * _is_published(values)


def _is_published(values: Mapping[str, Any]) -> bool:
    return any(values.get(key, "small") != "small" for key in ("sam2_config", "clip_model"))


def can_use_gpu(stage: str) -> bool:
    """Whether a stage has a key that lets models or rendering run on a GPU."""
    return not {"device", "backend"}.isdisjoint(stage_sections(stage).get("run", ()))


def gpus(stage: str, config: Config) -> int:
    """GPUs that a job of the stage can use: 1 if a key lets models or rendering run on one, else 0."""
    # Tracks are copied as they are.
    idle = {"segments": config["segments"]["segmenter"] == "classical", "instances": not merges_masks(config)}
    values = stage_values(stage, config)
    wanted = any(values.get(key) in ("auto", "cuda") for key in ("device", "backend"))
    return int(wanted and not idle.get(stage))
