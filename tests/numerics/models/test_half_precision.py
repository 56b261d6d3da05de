"""The bundled models in bfloat16, and their stored float16 weights, against float32."""

import numpy as np
import pytest
import torch

from egosplat.features.crops import encode as encode_crops
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.models.point_decoder import PointDecoder, encode
from egosplat.models.sam2_loader import load_sam2
from egosplat.query.text import encode_phrases


def pictures(height: int, width: int) -> list[np.ndarray]:
    """Noise, black, white, and a square on a ground."""
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    square = np.full_like(noise, 90)
    square[height // 4 : height // 2 + 1, width // 4 : width // 2 + 1] = (220, 30, 30)
    return [noise, np.zeros_like(noise), np.full_like(noise, 255), square]


@pytest.mark.numerics(
    "OpenCLIP in bfloat16: 1 - cosine with float32",
    within=1e-2,
    outside="features that are not finite are skipped",
)
def test_open_clip(measured):
    exact, half = (load_open_clip("small", "small", "cpu", kind) for kind in ("float32", "bfloat16"))
    crops = np.stack(pictures(*exact.preprocessing.image_size))
    phrases = ["couch", "a tea kettle on a table", "a red square"]
    found = []
    for clip in (exact, half):
        found.append(np.concatenate([encode_crops(clip, crops), encode_phrases(clip, phrases).numpy()]))
    lengths = [np.linalg.norm(rows, axis=1) for rows in found]
    assert all(np.allclose(length, 1.0, atol=1e-2) for length in lengths)
    measured(float((1 - (found[0] * found[1]).sum(1) / (lengths[0] * lengths[1])).max()))


@pytest.mark.numerics(
    "SAM2 in bfloat16, pictures of 1x1 and 40x60 px: share of pixels unlike float32",
    within=0.05,
    outside="finite logits and predicted IoU",
)
def test_sam2(measured):
    points = torch.tensor([[0.4, 0.4], [0.9, 0.1]])
    exact, half = (load_sam2("small", "small", "cpu", kind, 128) for kind in ("float32", "bfloat16"))
    for picture in [*pictures(40, 60), *pictures(1, 1)[:2]]:
        found = []
        for sam2 in (exact, half):
            with sam2.compute.inference():
                decoder = PointDecoder(sam2, encode(sam2, picture))
                attended = decoder.attend(points)
                logits, ious = decoder.logits(attended), attended.ious
            assert logits.isfinite().all() and ious.isfinite().all()
            found.append(logits.float() > 0)
        measured(float((found[0] != found[1]).float().mean()))
