"""Segment single frames with SAM2: each mask is an instance of its own; only what moves is tracked."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint, State
from egosplat.models.image_encoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.progress import log, track
from egosplat.segments.crops import prompt_with_crops
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import DamagedLabels, LabelMaps, paint
from egosplat.segments.moving import MovingTracker, add_tracks
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import filter_masks, grid_points, lie_in, prompt, prompted_frames


class SingleFrames:
    """Prompts every ``key_frame_stride``-th frame with the whole grid of points. Other frames show only what moves."""

    def __init__(
        self,
        sam2: Sam2,
        images: Callable[[int], NDArray[np.uint8]],
        frames: NDArray[np.intp],
        length: int,
        valid: NDArray[np.bool_],
        options: SegmentsOptions,
        movers: MovingTracker | None = None,
        points: Callable[[int], Tensor | None] = lambda _: None,
        shown: Callable[[int], NDArray[np.bool_]] | None = None,
    ) -> None:
        """Set up for a video.

        Args:
            sam2: the model at its own image size. Only whole frames are prompted at that of the options: crops are
                larger anyway, and tracking takes time by its fourth power.
            frames: indices of the frames that may be prompted, of the ``length`` of the video.
            movers: tracks what moves through all frames, after the masks are found; None to track nothing.
            points: returns the (P, 2) points of a frame index, x, y in [0, 1]; None for a grid, in crops as well.
            images, valid, options, shown: see ``Tracker``.
        """
        self._sam2, self._images, self._options = sam2, images, options
        self._frames, self._length = prompted_frames(frames, options), length
        self._movers, self._points, self._shown = movers, points, shown or (lambda _: valid)
        self._empty = np.full((len(LEVELS), *valid.shape), -1, np.int32)
        self._labels = LabelMaps(self._empty.shape)
        self._instances: list[Track] = []
        self._done = 0

    def run(self, checkpoint: Checkpoint | None = None) -> Segmented:
        """Segment the frames, resuming from the checkpoint if it holds a state."""
        if checkpoint is None:
            return self._segment_video(lambda: None)
        self._labels.path = checkpoint.file.with_name("labels")
        if self._movers:
            self._movers.keep_labels_in(checkpoint.file.with_name("labels_of_movers"))
        if (saved := checkpoint.load()) is not None:
            try:
                self.load_state_dict(saved)
                log(f"segmentation resumes after {self._done} frames")
            except DamagedLabels as error:
                log(str(error))
        return self._segment_video(lambda: checkpoint.save_if_due(self.state_dict))

    def _segment_video(self, save: Callable[[], None]) -> Segmented:
        with self._sam2.compute.inference():
            for frame in track(self._frames[self._done :], "segmenting frames"):
                self._segment(frame)
                self._done += 1
                save()
        for frame in set(range(self._length)) - set(self._frames):
            self._labels[frame] = self._empty
        found = Segmented(self._labels, self._instances, [], {"key_frames": self._frames})
        if self._movers is None:
            return found
        return add_tracks(found, self._movers.moving_tracks(save))

    def state_dict(self) -> State:
        """The progress as tensors, numbers, lists and dictionaries."""
        return {
            "done": self._done,
            "instances": [vars(instance) for instance in self._instances],
            "labels": self._labels.state_dict(),
            "movers": self._movers.state_dict() if self._movers else None,
        }

    def load_state_dict(self, state: State) -> None:
        """Resume from a ``state_dict``."""
        self._labels.load_state_dict(state["labels"])
        if self._movers:
            self._movers.load_state_dict(state["movers"])
        self._done = state["done"]
        self._instances = [Track(**values) for values in state["instances"]]

    def _segment(self, frame: int) -> None:
        image, placed = self._images(frame), self._points(frame)
        points = grid_points(self._options.points_per_side) if placed is None else placed
        shown = self._shown(frame)
        # Where a frame shows nothing, there is nothing to segment.
        points = points[lie_in(points, torch.from_numpy(shown))]
        with self._sam2.at_side(self._options.image_size):
            found = prompt(self._sam2, encode(self._sam2, image), points, self._options)
        if self._options.crops_per_side > 1 and placed is None:
            found = prompt_with_crops(self._sam2, image, shown, found, self._options)
        labels = []
        for level, candidates in enumerate(found):
            masks = filter_masks(candidates, self._options)
            first = len(self._instances)
            scores = zip(masks.predicted_iou.tolist(), masks.stability.tolist(), strict=True)
            self._instances += [Track(level, frame, iou, stability) for iou, stability in scores]
            ids = list(range(first, len(self._instances)))
            labels.append(paint([(ids, masks.logits)], shown, self._sam2.compute.device))
        self._labels[frame] = np.stack(labels)
