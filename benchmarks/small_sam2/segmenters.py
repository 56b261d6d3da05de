"""The compared segmenters: each answers point prompts and tracks masks."""

import contextlib
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch
from PIL import Image

from benchmarks.small_sam2.worlds import Film, Masks, Still
from egosplat.models.sam2_loader import Sam2, load_sam2
from egosplat.segments.classical import LEAST_SUPPORT, PURITY, WorkingImage, find_origins, partition

if TYPE_CHECKING:
    from sam2.sam2_image_predictor import SAM2ImagePredictor

_POINTS_PER_BATCH = 32

# Strides of the image encoder's three feature maps, finest first [px].
_STRIDES = (4, 8, 16)


class Segmenter(Protocol):
    """A compared segmenter."""

    def point(self, still: Still) -> Masks:
        """(K, 3, H, W) masks of each point, by level."""

    def track(self, film: Film) -> Masks:
        """(K, T, H, W): the masks of the first frame, tracked."""


def image_predictor(sam2: Sam2) -> "SAM2ImagePredictor":
    """A predictor for single frames with the same weights: ``set_image`` and ``predict``."""
    from sam2.sam2_image_predictor import SAM2ImagePredictor

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*torch.jit.script.* is deprecated")
        predictor = SAM2ImagePredictor(sam2.video_predictor)
    # SAM2 hard-codes the sizes for frames of 1024 px.
    side = sam2.video_predictor.image_size
    predictor._bb_feat_sizes = [(side // stride, side // stride) for stride in _STRIDES]
    return predictor


class Sam2Segmenter:
    """SAM2 by its own predictors."""

    def __init__(self, sam2: Sam2) -> None:
        self._sam2 = sam2
        self._predictor = image_predictor(sam2)

    def point(self, still: Still) -> Masks:
        """One point a prompt, three masks."""
        masks = []
        with self._sam2.compute.inference():
            self._predictor.set_image(still.rgb)
            for first in range(0, len(still.points), _POINTS_PER_BATCH):
                points = still.points[first : first + _POINTS_PER_BATCH, None]
                found, _, _ = self._predictor.predict(
                    point_coords=points, point_labels=np.ones(points.shape[:2], np.int32)
                )
                masks.append(found.reshape(-1, 3, *found.shape[-2:]) > 0)
        return np.concatenate(masks)

    def track(self, film: Film) -> Masks:
        """The video predictor, on the frames as JPEG files."""
        predictor = self._sam2.video_predictor
        tracked = np.zeros(film.masks.shape, dtype=bool)
        with _as_files(film) as folder, self._sam2.compute.inference():
            state = predictor.init_state(str(folder))
            for number, mask in enumerate(film.masks[:, 0]):
                predictor.add_new_mask(state, 0, number, torch.from_numpy(mask))
            for frame, numbers, logits in predictor.propagate_in_video(state):
                tracked[numbers, frame] = (logits[:, 0] > 0).cpu().numpy()
        return tracked


class ClassicalSegmenter:
    """Regions by color and edges, tracked by optical flow."""

    def point(self, still: Still) -> Masks:
        """The regions of three levels at each point."""
        labels = partition(WorkingImage(still.rgb, still.valid))[1:]
        columns, rows = still.points.astype(int).T
        values = labels[:, rows, columns].T
        return (labels[None] == values[..., None, None]) & (values >= 0)[..., None, None]

    def track(self, film: Film) -> Masks:
        """By optical flow, snapped to regions."""
        previous, masks = None, film.masks[:, 0] & film.valid
        tracked = []
        for rgb in film.rgb:
            image = WorkingImage(rgb, film.valid)
            regions = partition(image)[0]
            if previous is not None:
                rows, columns, known = find_origins(previous, image)
                brought = masks[..., rows, columns] & known
                masks = np.array([_snap(one, known, regions) for one in brought], bool)
            previous = image
            tracked.append(masks)
        return np.stack(tracked, axis=1)


def _snap(mask: Masks, known: Masks, regions: np.ndarray) -> Masks:
    """Fit a (H, W) mask to regions: one joins if most of its pixels are in the mask, and leaves if few are."""
    count = int(regions.max(initial=-1)) + 1
    size = np.bincount(regions[regions >= 0], minlength=count)
    voters = np.bincount(regions[known & (regions >= 0)], minlength=count)
    yes = np.bincount(regions[mask & known & (regions >= 0)], minlength=count)
    decided = (voters > 0) & (voters >= LEAST_SUPPORT * size)
    # Index -1, a pixel without a region, selects the last entry.
    taken = np.append(decided & (yes >= PURITY * voters), False)
    left = np.append(decided & (voters - yes >= PURITY * voters), True)
    return taken[regions] | (mask & known & ~left[regions])


@contextlib.contextmanager
def _as_files(film: Film) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        for number, frame in enumerate(film.rgb):
            Image.fromarray(frame).save(Path(folder) / f"{number:05d}.jpg", quality=95)
        yield Path(folder)


def small_sam2(checkpoint: str) -> Sam2Segmenter:
    """The shipped configuration with a checkpoint."""
    return Sam2Segmenter(load_sam2("small", checkpoint, "auto", "auto"))
