"""How SAM2 is asked for instances, and which of its masks are kept."""

from dataclasses import dataclass

LEVELS = ("subpart", "part", "whole")
"""The levels in the order of SAM2's three masks for one point (docs/method.md#levels)."""


@dataclass(frozen=True)
class MaskOptions:
    """Which masks of one picture are kept, by the paper's criteria (docs/method.md#mask-filters).

    Attributes:
        points_per_side: of the grid of point prompts.
        pred_iou_thresh, stability_score_thresh: masks below are dropped.
        stability_score_offset: by how much logits are cut higher and lower for the stability score.
        box_nms_thresh: of two boxes with a larger IoU the one of lower predicted IoU is dropped.
        nms_iou_thresh, nms_score_thresh, nms_inner_thresh: see ``nms.mask_nms``.
        min_area: smaller masks are dropped; share of the picture.
    """

    points_per_side: int
    pred_iou_thresh: float
    stability_score_thresh: float
    stability_score_offset: float
    box_nms_thresh: float
    nms_iou_thresh: float
    nms_score_thresh: float
    nms_inner_thresh: float
    min_area: float


@dataclass(frozen=True)
class TrackOptions:
    """Which instances are followed, and which of them are kept.

    Attributes:
        key_frames: whether frames after the first are prompted too, where nothing is followed
            (docs/method.md#prompting).
        key_frame_stride: frames from one look at what is not covered to the next.
        min_uncovered: a level is prompted anew where a larger share of the picture is not covered.
        new_cover_thresh: a new mask of which more is already covered is dropped.
        merge_iou: instances of a level whose masks overlap more, where both are seen, are one.
        min_frames: instances seen in fewer frames are dropped, but never for a video that is itself shorter.
        max_instances: at most so many are followed at a time, for each level.
        share_iou: what is found alike at two levels, with at least this IoU, is followed once for both.
        absent_stride: see ``following.Follower``.
        batch: objects that pass through the model together; more are faster on a GPU and take more memory.
    """

    key_frames: bool
    key_frame_stride: int
    min_uncovered: float
    new_cover_thresh: float
    merge_iou: float
    min_frames: int
    max_instances: int
    share_iou: float
    absent_stride: int
    batch: int
