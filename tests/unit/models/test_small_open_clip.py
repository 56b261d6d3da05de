"""The packaged small OpenCLIP recognizes objects of the synthetic world by their names, on images it was not trained on.

The objects are built from seeds that no training world has, and rendered by a separate renderer.
"""

import hashlib

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from egosplat.models.checkpoints import SMALL_CLIP
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat_apartments.camera.raycasting import Body, build_geometry, interpolated, static_scene
from egosplat_apartments.objects.atlas import Atlas
from egosplat_apartments.objects.catalogue import CORE, GROUPS, REST, Kind

KINDS = {kind.category: kind for kind in (*CORE, *REST, *(one for group in GROUPS for one in group))}
NAMES = ("couch", "television", "step stool", "house plant")
NAMES += ("coffee table", "bowl", "refrigerator", "tea kettle")
SYNONYMS = ("settee", "telly", "footstool", "shrub", "cocktail table", "basin", "icebox", "teapot")
SIDE = 64


@pytest.fixture(scope="module")
def clip() -> OpenClip:
    """The packaged model."""
    return load_open_clip("small", "small", "cpu", "float32")


def render(kind: Kind, seed: int) -> np.ndarray:
    """(SIDE, SIDE, 3) uint8: an object on black, seen from the front, slightly from above and from one side."""
    model = kind.build(np.random.default_rng([seed, 77]))
    geometry = build_geometry([Body(1, model.parts, np.eye(4), "static")])
    lower, upper = geometry.vertices.min(axis=0), geometry.vertices.max(axis=0)
    center, reach = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2
    side = 0.5 if seed % 2 else -0.5
    away = np.array([np.sin(side), 0.5, np.cos(side)])
    away /= np.linalg.norm(away)
    right = np.cross([0, 1, 0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    place = (np.arange(2 * SIDE) + 0.5) / SIDE - 1
    x, y = np.meshgrid(place, -place)
    rays = -away + 0.3 * (x.ravel()[:, None] * right + y.ravel()[:, None] * up)
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    hits = static_scene(geometry).cast((center + 3.5 * reach * away).astype(np.float32), rays)
    normals, uv = (interpolated(geometry, hits, values) for values in (geometry.normals, geometry.uv))
    texture = geometry.part_texture[geometry.face_part[hits.face]]
    width = np.full(len(rays), 0.3 * 3.5 * reach / SIDE, dtype=np.float32)
    light = 0.45 + 0.55 * np.abs(normals @ (0.3, 0.8, 0.5))
    rgb = np.sqrt(np.clip(Atlas(geometry.textures).albedo(texture, uv, width) * light[:, None], 0, 1))
    rgb[hits.face < 0] = 0
    return squared((255 * rgb).astype(np.uint8).reshape(2 * SIDE, 2 * SIDE, 3))


def squared(image: np.ndarray) -> np.ndarray:
    """Crop to the pixels that are not black, pad to a square and resize to (SIDE, SIDE, 3)."""
    rows, columns = (np.flatnonzero(image.any(axis=(2, other))) for other in (1, 0))
    inside = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    height, width = inside.shape[:2]
    side = max(height, width)
    square = np.zeros((side, side, 3), dtype=np.float32)
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = inside
    resized = F.interpolate(
        torch.from_numpy(square).permute(2, 0, 1)[None], (SIDE, SIDE), mode="bilinear", antialias=True
    )
    return resized[0].permute(1, 2, 0).numpy().astype(np.uint8)


def encode(clip: OpenClip, images: list[np.ndarray]) -> torch.Tensor:
    """(N, D) of unit norm."""
    values = torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255
    mean, std = (
        torch.tensor(numbers)[:, None, None] for numbers in (clip.preprocessing.mean, clip.preprocessing.std)
    )
    with clip.compute.inference():
        return F.normalize(clip.model.encode_image((values - mean) / std).float(), dim=-1)


def texts(clip: OpenClip, phrases: tuple[str, ...]) -> torch.Tensor:
    """(N, D) of unit norm."""
    with clip.compute.inference():
        return F.normalize(clip.model.encode_text(clip.tokenizer(list(phrases))).float(), dim=-1)


@pytest.fixture(scope="module")
def features(clip: OpenClip) -> torch.Tensor:
    """(8 kinds, 4 seeds, D)."""
    images = [render(KINDS[name], seed) for name in NAMES for seed in range(4)]
    return encode(clip, images).reshape(len(NAMES), 4, -1)


def test_objects_are_found_by_their_names_and_by_synonyms_outside_of_the_captions(clip, features) -> None:
    right = (features @ texts(clip, NAMES).T).argmax(dim=-1) == torch.arange(len(NAMES))[:, None]
    # Chance is one in eight.
    assert right.float().mean() >= 0.8
    averaged = F.normalize(features.mean(dim=1), dim=-1)
    nearest = (averaged @ texts(clip, SYNONYMS).T).argmax(dim=-1)
    assert (nearest == torch.arange(len(NAMES))).sum() >= 6


def test_the_model_card_names_the_checkpoint_s_hash() -> None:
    digest = hashlib.sha256((SMALL_CLIP / "open_clip_model.safetensors").read_bytes()).hexdigest()
    assert digest in (SMALL_CLIP / "MODEL_CARD.md").read_text()
