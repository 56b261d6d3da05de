"""The learning curve of SAM2: scores on held-out worlds, a row for each measurement."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from sam2.modeling.sam2_base import SAM2Base

from egosplat.files import atomic_file
from egosplat.models.sam2_loader import set_image_size
from training.small_models.sam2_data import Clip, perimeters, sample_tracks, to_input
from training.small_models.sam2_losses import Guides
from training.small_models.sam2_steps import clip_step, decode, encode_image
from training.small_models.worlds import RenderedWorld

# Classes of wholes by the least share of the image that they cover.
SIZES = {"0.1-1 %": 0.001, "1-5 %": 0.01, "> 5 %": 0.05}

# Least perimeter^2 / area of a thin whole. A square has 16, a bar of 10 to 1 has 48.
_THIN = 50.0

_POINTS, _TRACKS = 16, 4

Scores = dict[str, float]


@torch.no_grad()
def held_out_scores(model: SAM2Base, guides: Guides, worlds: Sequence[RenderedWorld], side: int) -> Scores:
    """Score a model on held-out worlds.

    Args:
        model: is set to evaluation and to images of ``side`` [px]; guides: of its training.
        worlds: the first and the last image of the first clip are prompted; masks are tracked through the first clip
            of every second world.

    Returns:
        Mean IoU of wholes, best of three masks from a point, by size and of thin ones; and of ``tracked`` masks.
        NaN if there are none.
    """
    model.eval()
    set_image_size(model, side)
    found: dict[str, list[float]] = {name: [] for name in (*SIZES, "thin", "tracked")}
    for number, world in enumerate(worlds):
        rng = np.random.default_rng([number, 7])
        for frame in (0, -1):
            labels = world.labels(world.subpart[0, frame])[2]
            _score_points(model, np.asarray(world.rgb[0, frame]), labels, rng, found)
        # Tracking is slow.
        if number % 2 == 0:
            clip = _clip(world, side)
            tracks = sample_tracks(clip, rng, _TRACKS)
            found["tracked"] += clip_step(model, guides, 0.0, [clip], [tracks]).ious.tolist()
    return {name: float(np.mean(values)) if values else float("nan") for name, values in found.items()}


def _score_points(
    model: SAM2Base,
    rgb: NDArray[np.uint8],
    labels: NDArray[np.int32],
    rng: np.random.Generator,
    found: dict[str, list[float]],
) -> None:
    """Add the IoU of the best of three masks of each whole, from a random pixel of it."""
    areas, outlines = np.bincount(labels.ravel() + 1)[1:], perimeters(labels)
    kept = np.flatnonzero(areas >= SIZES["0.1-1 %"] * labels.size)
    values = rng.permutation(kept)[:_POINTS]
    places = np.array([rng.choice(np.flatnonzero(labels == value)) for value in values])
    rows, columns = np.divmod(places, labels.shape[1])
    side = model.image_size
    points = (np.stack([columns, rows], axis=1) + 0.5) * (side / np.array(labels.shape[::-1]))
    device = next(model.parameters()).device
    image = to_input(_resize(rgb, side, cv2.INTER_AREA)[None]).to(device)
    features = [one.repeat_interleave(len(values), 0) for one in encode_image(model, image)[0]]
    given = features[2] + model.no_mem_embed.view(1, -1, 1, 1)
    logits = decode(model, given, features[:2], torch.from_numpy(points).float().to(device))[0][:, 1:]
    masks = (F.interpolate(logits, labels.shape, mode="bilinear") > 0).cpu().numpy()
    for value, three in zip(values, masks, strict=True):
        truth = labels == value
        iou = float(max((mask & truth).sum() / (mask | truth).sum() for mask in three))
        size = [name for name, least in SIZES.items() if areas[value] >= least * labels.size][-1]
        found[size].append(iou)
        if outlines[value] ** 2 >= _THIN * areas[value]:
            found["thin"].append(iou)


def _clip(world: RenderedWorld, side: int) -> Clip:
    """The first clip, without the names of parts."""
    pictures = np.stack([_resize(rgb, side, cv2.INTER_AREA) for rgb in world.rgb[0]])
    labels = world.labels(np.stack([_resize(one, side, cv2.INTER_NEAREST) for one in world.subpart[0]]))
    return Clip(pictures, labels, np.full_like(labels[0], -1))


def _resize(image: np.ndarray, side: int, interpolation: int) -> np.ndarray:
    return cv2.resize(np.asarray(image), (side, side), interpolation=interpolation)


def write_curve(path: Path, rows: Sequence[Mapping[str, float]]) -> None:
    """Write the rows as a table with tabs, atomically."""
    lines = ["\t".join(rows[0]), *("\t".join(_text(value) for value in row.values()) for row in rows)]
    with atomic_file(path) as scratch:
        Path(scratch).write_text("\n".join(lines) + "\n")


def _text(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.4f}"
