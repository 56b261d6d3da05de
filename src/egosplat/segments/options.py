"""Options of the stage ``segments``, and the names of its levels."""

from dataclasses import dataclass

# The levels in the order of SAM2's three masks for one point (docs/method.md#levels).
LEVELS = ("subpart", "part", "whole")

EACH_FRAME = "each_frame"
"""Value of ``prompting`` without tracking: each mask of each prompted frame is an instance of its own."""


@dataclass(frozen=True)
class SegmentsOptions:
    """Keys of the sections ``segments`` and ``models`` (SAM2's); ``config.schema.yaml`` describes each."""

    segmenter: str
    image_size: int | None

    # Which masks of a frame are kept (docs/method.md#mask-filters).
    points_per_side: int
    crops_per_side: int
    pred_iou_thresh: float
    stability_score_thresh: float
    stability_score_offset: float
    box_nms_thresh: float
    nms_iou_thresh: float
    nms_score_thresh: float
    nms_inner_thresh: float
    min_area: float

    # Which instances are tracked (docs/method.md#prompting), and which of them are kept.
    prompting: str
    key_frame_stride: int
    point_prompts: str
    track_moving: str
    min_uncovered_fraction: float
    max_covered_new: float
    merge_iou: float
    min_frames: int
    max_instances: int
    cross_level_iou: float
    lost_track_stride: int
    batch: int
    # masks.threshold: mean probability from which a mask is of something that moves.
    threshold: float

    sam2_config: str
    sam2_checkpoint: str
    device: str
    precision: str

    @property
    def single_frames(self) -> bool:
        """Whether masks of single frames are instances of their own, and at most what moves is tracked."""
        return self.segmenter == "sam2" and self.prompting == EACH_FRAME

    @property
    def by_depth(self) -> bool:
        """Whether the stage ``prompts`` places the points of single frames."""
        return self.single_frames and self.point_prompts == "depth"
