"""Stage ``tiles``: encode the tiles of each training frame with OpenCLIP, at seven scales, as LERF does."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Work, lie_within
from egosplat.artifacts.consistency import kept_frames
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, TILE_SCALES, TILES, lies_on_its_side
from egosplat.artifacts.writer import Writer, create
from egosplat.errors import UserError
from egosplat.features.compression import fit_linear
from egosplat.features.crops import encode, resize
from egosplat.models import point_decoder
from egosplat.models.checkpoints import CLIP, SAM2, SMALL, model_hash
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.models.sam2_loader import Sam2, load_sam2
from egosplat.progress import log, track
from egosplat_rivals.options import TilesOptions
from egosplat_rivals.tile_views import Scale, pyramid

Pixels = NDArray[np.uint8]
Halves = NDArray[np.float16]

# Tiles per OpenCLIP batch. The order of sums, and so the last digit, depends on it.
BATCH = 128


def run(
    frames_path: Path,
    output: Path,
    options: TilesOptions,
    *,
    survey_path: Path | None = None,
    chunk: int | None = None,
    gather: Sequence[Path] = (),
) -> None:
    """Write the tiles of the training frames, but for those that a survey excludes; ``chunk`` and ``gather`` as in ``Work``.

    A killed run resumes and gives identical features. UserError if an input or a model cannot be read, or no frame trains.
    """
    frames = open_artifact(frames_path, FRAMES)
    kept, by_survey = kept_frames(frames, survey_path)
    rows = np.flatnonzero(frames.read("train") & kept)
    if not len(rows):
        raise UserError(f"{frames_path}: no frame is for training; see frames.holdout")
    keys, models = options.as_dict(), [CLIP, *([SAM2] if options.regulariser == "sam2" else [])]
    used = {model.checkpoint_key: model_hash(model, keys) for model in models}
    record = provenance.begin_from("tiles", keys | by_survey, [frames], used)
    _, height, width, _ = frames.shape("rgb")
    scales, turned = pyramid(height, width), lies_on_its_side(frames)

    def encode_rows(rows: NDArray[np.integer]) -> Iterator[Tensor]:
        clip = load_open_clip(options.clip_model, options.clip_checkpoint, options.device, options.precision)
        for row in rows:
            yield torch.from_numpy(encode_tiles(clip, frames.row("rgb", row), scales, turned))

    work = Work(output, record, frames.shape("rgb")[0], chunk, gather)
    found = work.results(lambda chunks: rows[lie_within(rows, chunks)], encode_rows, "encoding tiles")
    if found is None:
        return
    done = [tiles.numpy() for tiles in found]
    clip = {"model": options.clip_model, "checkpoint": options.clip_checkpoint}
    facts = {
        "clip": clip | {"small": options.clip_checkpoint == SMALL, "hash": used[CLIP.checkpoint_key]},
        "scales": [asdict(scale) for scale in scales],
        "regulariser": options.regulariser,
    }
    with create(output, TILES, replace(record, gathered=work.costs)) as artifact:
        artifact.put("frame", rows.astype(np.int32))
        _put_tiles(artifact, done, scales)
        if options.regulariser == "sam2":
            given = options.sam2_config, options.sam2_checkpoint, options.device, options.precision
            maps = image_maps(load_sam2(*given), lambda row: frames.row("rgb", row), rows)
            artifact.put("regulariser", maps)
        artifact.facts = facts
    work.finish()
    lost = sum(int((~one.any(axis=1)).sum()) for one in done)
    without = f", {lost} without a feature" if lost else ""
    log(f"{sum(map(len, done)):,} tiles of {len(rows)} frames{without}")


def encode_tiles(clip: OpenClip, rgb: Pixels, scales: list[Scale], turned: bool) -> Halves:
    """(T, D) float16 unit features of all tiles of an (H, W, 3) uint8 frame, scale by scale, row by row; 0 if not finite.

    The tiles of a frame that lies on its side, ``turned``, are turned upright.
    """
    wanted = clip.preprocessing
    tiles = [
        resize(np.rot90(tile, -1) if turned else tile, wanted.image_size, wanted.interpolation)
        for scale in scales
        for tile in cut_tiles(rgb, scale)
    ]
    parts = [encode(clip, np.stack(tiles[begin : begin + BATCH])) for begin in range(0, len(tiles), BATCH)]
    return np.nan_to_num(np.concatenate(parts)).astype(np.float16)


def cut_tiles(rgb: Pixels, scale: Scale) -> Iterator[Pixels]:
    """Yield the (K, K, 3) tiles of an image, row by row; black beyond its border."""
    margin, side = scale.kernel // 2, scale.kernel
    padded = np.pad(rgb, ((margin, margin), (margin, margin), (0, 0)))
    for row in range(scale.rows):
        for column in range(scale.columns):
            top, left = row * scale.stride, column * scale.stride
            yield padded[top : top + side, left : left + side]


def _put_tiles(artifact: Writer, done: list[Halves], scales: list[Scale]) -> None:
    begin = 0
    for number, scale in enumerate(scales):
        end, shape = begin + scale.rows * scale.columns, (scale.rows, scale.columns, done[0].shape[1])
        artifact.put(TILE_SCALES[number], np.stack([tiles[begin:end].reshape(shape) for tiles in done]))
        begin = end


# Most principal components that are kept, and most frames that they are computed from.
COMPONENTS, _FRAMES = 64, 32


def image_maps(sam2: Sam2, images: Callable[[int], Pixels], rows: NDArray[np.integer]) -> Halves:
    """Encode frames at SAM2's coarsest resolution, one sixteenth of its square, and keep the principal components.

    (V, h, w, K) float16 components of the channels, each channel of mean 0 and variance 1 over the scene. ``images`` gives the
    (H, W, 3) uint8 image of a frame, by its row.
    """
    few = rows[np.linspace(0, len(rows) - 1, min(len(rows), _FRAMES)).astype(int)]
    sample = np.concatenate([_map(sam2, images(row)) for row in few]).astype(np.float64)
    mean, deviation = sample.mean(axis=(0, 1)), sample.std(axis=(0, 1), ddof=1)
    # A channel that never changes says nothing.
    scale = np.where(deviation > 1e-6 * (1 + np.abs(mean)), 1 / np.maximum(deviation, 1e-12), 0.0)
    basis = fit_linear(((sample - mean) * scale).reshape(-1, len(mean)).astype(np.float32), COMPONENTS)
    found = []
    for row in track(rows, "encoding frames with SAM2"):
        values = ((_map(sam2, images(row)) - mean) * scale).astype(np.float32)
        codes = basis.encode(values.reshape(-1, len(mean)))
        found.append(codes.reshape(*values.shape[:2], -1).astype(np.float16))
    return np.stack(found)


def _map(sam2: Sam2, image: Pixels) -> NDArray[np.float32]:
    """(h, w, C) values of the coarsest features."""
    with sam2.compute.inference():
        return point_decoder.encode(sam2, image).image(-1)[0].permute(1, 2, 0).float().cpu().numpy()
