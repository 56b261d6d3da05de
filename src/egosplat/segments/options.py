"""Options of the stage ``segments``, and the names of its levels."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from egosplat.pipeline.options import READING, Count, Share
from egosplat.pipeline.shared_options import (
    DeviceOptions,
    MaskSourceOptions,
    Sam2Options,
    SetOptions,
    ThresholdOptions,
)

# The levels in the order of SAM2's three masks for one point (docs/method.md#levels).
LEVELS = ("subpart", "part", "whole")

# Of 25 photographs every eighth is four, which show hardly a thing twice.
_MIN_KEY_FRAMES = 16


@dataclass(frozen=True)
class MaskFilter:
    """Which of SAM2's masks of a frame are kept (docs/method.md#mask-filters). The paper names none; those of LangSplat.

    Attributes:
        pred_iou_thresh: least IoU as predicted by SAM2.
        stability_score_thresh, stability_score_offset: least IoU of the masks cut an offset above and below 0, and the offset [logits].
        nms_score_thresh: masks with this score (predicted IoU x stability) or less are dropped.
        nms_iou_thresh, nms_inner_thresh: see ``masks.mask_nms``.
        box_nms_thresh: box IoU above which the mask with the lower predicted IoU is dropped.
    """

    pred_iou_thresh: float
    stability_score_thresh: float
    stability_score_offset: float
    nms_score_thresh: float
    nms_iou_thresh: float = 0.8
    nms_inner_thresh: float = 0.5
    box_nms_thresh: float = 0.7


# By models.set.
MASK_FILTERS = {
    **dict.fromkeys(("auto", "small", "photos"), MaskFilter(0.3, 0.7, 0.1, 0.2)),
    **dict.fromkeys(("light", "published"), MaskFilter(0.7, 0.85, 1.0, 0.7)),
}


class SegmentsOptions(MaskSourceOptions, SetOptions, Sam2Options, DeviceOptions, ThresholdOptions):
    """Instances at three levels, found with point prompts and tracked through the video."""

    image_size: Annotated[int, Field(ge=128, multiple_of=32)] | None = 512
    """Side in pixels of the square that SAM2 resizes frames to, a multiple of 32. null uses the architecture's own
    size, 320 for the small model and 1024 for the published ones. Larger resolves smaller objects and sharper
    edges; time grows with its square. Where prompting is each_frame, crops keep the architecture's own size, and so
    do tracks, but with models.set=light (512)."""

    points_per_side: Count = 12
    """Side of the grid of point prompts. The paper uses 32. A denser grid finds smaller objects; the time per
    prompted frame grows with its square."""

    crops_per_side: Annotated[int, Field(ge=1, le=8)] = 3
    """Side of the grid of overlapping crops that are prompted in addition to each whole frame, where prompting is
    each_frame. A crop shows small things larger; masks of large things come from the whole frame. 1 uses no crops.
    The time per prompted frame grows with its square."""

    min_area: Annotated[Share, READING] = 0.0005
    """Drop masks smaller than this fraction of the frame. Small masks give poor features."""

    prompting: Literal["initial_frame", "each_frame"] = "each_frame"
    """Frames that are prompted (docs/method.md#prompting). initial_frame: only the first, as the paper's text says; a
    head-mounted camera soon leaves that view. each_frame: key frames by themselves, without tracking; the stage
    instances merges their masks."""

    key_frame_stride: Count = 4
    """Segment every N-th training frame that has a pose, where prompting is each_frame; more of them, at most all, if
    these are fewer than 16. Smaller finds more and is slower."""

    track_moving: Literal["auto", "never", "always"] = "auto"
    """Whether people, hands and carried things are tracked in 2D where prompting is each_frame: masks whose mean
    probability of the transient network reaches masks.threshold. auto: if the survey finds motion; by hand, if
    transient.zarr is given."""

    min_frames: Annotated[Count, READING] = 3
    """Drop instances seen in fewer frames. In a video with fewer frames, drop those not seen in all of them."""

    max_instances: Annotated[Count, READING] = 200
    """Largest number of instances tracked at once per level; the best are kept. Time and memory grow with it."""

    def key_frames(self, training: NDArray[np.intp]) -> NDArray[np.intp]:
        """Those of (N,) training frames that are segmented by themselves."""
        return training[:: max(1, min(self.key_frame_stride, len(training) // _MIN_KEY_FRAMES))]

    @property
    def track_side(self) -> int | None:
        """Side to which SAM2 resizes frames where it tracks what moves; None for its own. Without a GPU, 1024 takes ten times as long."""
        return 512 if self.set == "light" else None

    @property
    def mask_filter(self) -> MaskFilter:
        """Which of SAM2's masks are kept."""
        return MASK_FILTERS[self.set]

    @property
    def single_frames(self) -> bool:
        """Whether masks of single frames are instances of their own, and at most what moves is tracked."""
        return self.segmenter == "sam2" and self.prompting == "each_frame"
