"""Time of the paper's models for one frame, one prompt, one tracked instance in one frame, and one crop.

The weights are random, which does not change the time. These unit costs replace those of the small models where laws are
extrapolated to the paper's settings.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.common import timed
from benchmarks.published_models.weights import CLIP, SAM2, save_clip, save_sam2
from benchmarks.segments_growth.__main__ import keep_all
from egosplat.models.image_encoder import EncodedImage, encode
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.models.sam2_loader import Sam2, load_sam2
from egosplat.segments.prompts import prompt
from egosplat.segments.propagation import Propagator

OBJECTS, PROMPTS, CROPS = 2, 4, 4


def measure() -> dict[str, float]:
    """Processor time of one thread [s], by unit: ``picture``, ``prompt``, ``tracked`` and ``crop``."""
    torch.set_num_threads(1)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "weights.pt"
        save_sam2(file)
        found = _sam2(load_sam2(SAM2, str(file), "cpu", "float32"))
        save_clip(file)
        return found | {"crop": _clip(file)}


def _sam2(sam2: Sam2) -> dict[str, float]:
    """Followed with full memory, which is the case in all frames but the first seven."""
    picture = np.random.default_rng(0).integers(0, 256, (512, 512, 3), dtype=np.uint8)
    options = keep_all(points_per_side=2)
    points = np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]], np.float32)
    with sam2.compute.inference():
        encode(sam2, picture)  # the first call is slower: it also sets up the libraries
        encoded, picture_s = timed(lambda: encode(sam2, picture))
        _, prompt_s = timed(lambda: prompt(sam2, encoded, torch.from_numpy(points[:PROMPTS]), options))
        tracked_s = _tracked(sam2, encoded)
    return {"picture": picture_s, "prompt": prompt_s / PROMPTS, "tracked": tracked_s}


def _tracked(sam2: Sam2, encoded: EncodedImage) -> float:
    """Seconds of an object in a frame; the same picture is every frame, which costs what others cost."""
    memories = sam2.video_predictor.num_maskmem
    propagator = Propagator(sam2, 100)
    side = sam2.video_predictor.image_size // 4
    logits = torch.full((OBJECTS, side, side), -10.0)
    logits[:, side // 4 : side // 2, side // 4 : side // 2] = 10.0
    group = propagator.begin(encoded, 0, list(range(OBJECTS)), logits)
    for frame in range(1, memories):
        propagator.step(lambda: encoded, frame, group, reverse=False)
    _, seconds = timed(lambda: propagator.step(lambda: encoded, memories, group, reverse=False))
    return seconds / OBJECTS


def _clip(file: Path) -> float:
    clip = load_open_clip(CLIP, str(file), "cpu", "float32")
    crops = torch.rand(CROPS, 3, *clip.preprocessing.image_size)
    with clip.compute.inference():
        clip.model.encode_image(crops)
        return timed(lambda: clip.model.encode_image(crops))[1] / CROPS


if __name__ == "__main__":
    import json

    json.dump({name: round(value, 4) for name, value in measure().items()}, sys.stdout)
