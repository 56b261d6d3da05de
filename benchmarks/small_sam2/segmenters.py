"""The segmenters that are compared: each answers to points, finds everything, and follows masks."""

import contextlib
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from benchmarks.small_sam2.worlds import Film, Picture
from egosplat.models.sam2_loader import Sam2, load_sam2
from egosplat.pipeline.config import section_keys
from egosplat.segments.classical import segmenter as classical

if TYPE_CHECKING:
    from sam2.sam2_image_predictor import SAM2ImagePredictor

Masks = NDArray[np.bool_]

_STRIDES = (4, 8, 16)
"""Of the image encoder's three feature maps, finest first [px of the model's picture]."""

_POINTS_A_BATCH = 32
_GRID = 16

_THRESHOLDS = ("pred_iou_thresh", "stability_score_thresh", "stability_score_offset")
"""Those of the configuration."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Masks for points.

    Attributes:
        masks: (K, 3, H, W) bool, by level; ious: (K, 3) predicted IoU, None where nothing is predicted.
    """

    masks: Masks
    ious: NDArray[np.float64] | None


class Segmenter(Protocol):
    """What is measured."""

    def point(self, picture: Picture) -> Answer:
        """Three masks for each point."""

    def everything(self, picture: Picture) -> Masks:
        """(M, H, W) masks of all that is found without being asked."""

    def follow(self, film: Film) -> Masks:
        """(K, T, H, W): the masks of the first frame, followed."""


def image_predictor(sam2: Sam2) -> "SAM2ImagePredictor":
    """A predictor for single pictures, with the same weights: ``set_image`` and ``predict``."""
    from sam2.sam2_image_predictor import SAM2ImagePredictor

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*torch.jit.script.* is deprecated")
        predictor = SAM2ImagePredictor(sam2.video_predictor)
    # SAM2 has the sizes for pictures of 1024 pixels written out.
    side = sam2.video_predictor.image_size
    predictor._bb_feat_sizes = [(side // stride, side // stride) for stride in _STRIDES]
    return predictor


class Sam2Segmenter:
    """SAM2 by its own predictors and its own automatic mask generator."""

    def __init__(self, sam2: Sam2) -> None:
        from sam2.automatic_mask_generator import SAM2AutomaticMaskGenerator

        self._sam2 = sam2
        self._predictor = image_predictor(sam2)
        keys = section_keys("segments")
        self._generator = SAM2AutomaticMaskGenerator(
            sam2.video_predictor,
            points_per_side=_GRID,
            **{name: keys[name]["default"] for name in _THRESHOLDS},
        )
        self._generator.predictor = self._predictor

    def point(self, picture: Picture) -> Answer:
        """One point a prompt, three masks."""
        masks, ious = [], []
        with self._sam2.compute.inference():
            self._predictor.set_image(picture.rgb)
            for first in range(0, len(picture.points), _POINTS_A_BATCH):
                points = picture.points[first : first + _POINTS_A_BATCH, None]
                found, predicted, _ = self._predictor.predict(
                    point_coords=points, point_labels=np.ones(points.shape[:2], np.int32)
                )
                masks.append(found.reshape(-1, 3, *found.shape[-2:]) > 0)
                ious.append(predicted.reshape(-1, 3))
        return Answer(np.concatenate(masks), np.concatenate(ious).astype(np.float64))

    def everything(self, picture: Picture) -> Masks:
        """A grid of points, filtered by predicted IoU and stability; what overlaps is thinned out."""
        with self._sam2.compute.inference():
            found = self._generator.generate(picture.rgb)
        shape = (0, *picture.valid.shape)
        return np.stack([each["segmentation"] for each in found]) if found else np.zeros(shape, bool)

    def follow(self, film: Film) -> Masks:
        """The video predictor, on the frames as JPEG files."""
        predictor = self._sam2.video_predictor
        followed = np.zeros(film.masks.shape, dtype=bool)
        with _as_files(film) as folder, self._sam2.compute.inference():
            state = predictor.init_state(str(folder))
            for number, mask in enumerate(film.masks[:, 0]):
                predictor.add_new_mask(state, 0, number, torch.from_numpy(mask))
            for frame, numbers, logits in predictor.propagate_in_video(state):
                followed[numbers, frame] = (logits[:, 0] > 0).cpu().numpy()
        return followed


class ClassicalSegmenter:
    """Regions by colour and edges, followed by optical flow."""

    def point(self, picture: Picture) -> Answer:
        """The regions of three levels at each point."""
        labels = self._segment(picture)
        columns, rows = picture.points.astype(int).T
        values = labels[:, rows, columns].T
        return Answer((labels[None] == values[..., None, None]) & (values >= 0)[..., None, None], None)

    def everything(self, picture: Picture) -> Masks:
        """All regions of all levels."""
        labels = self._segment(picture)
        return np.concatenate(
            [[level == value for value in np.unique(level[level >= 0])] for level in labels]
        )

    def follow(self, film: Film) -> Masks:
        """By optical flow, snapped to regions."""
        frames = classical.follow(film.masks[:, 0], film.rgb, film.valid, classical.ClassicalOptions())
        return np.stack(list(frames), axis=1)

    def _segment(self, picture: Picture) -> NDArray[np.int32]:
        return classical.segment(picture.rgb, picture.valid, classical.ClassicalOptions())


@contextlib.contextmanager
def _as_files(film: Film) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        for number, picture in enumerate(film.rgb):
            Image.fromarray(picture).save(Path(folder) / f"{number:05d}.jpg", quality=95)
        yield Path(folder)


def small_sam2(checkpoint: str) -> Sam2Segmenter:
    """The shipped configuration with a checkpoint."""
    return Sam2Segmenter(load_sam2("small", checkpoint, "auto", "auto"))
