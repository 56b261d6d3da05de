"""Following objects by SAM2's memory, in bounded memory.

SAM2's own predictor keeps, for every object and every frame, what it saw. What its memory attends to is the frame
in which an object began and the few frames before the present one: only those are kept here, and objects that
began together pass through the model together.
"""

from dataclasses import dataclass, field
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

from egosplat.models.holes import fill_holes
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.encoding import Encoded

Output = dict[str, Any]


@dataclass
class Group:
    """Objects that began in one frame.

    Attributes:
        ids: of the objects, in the order of the batch.
        first_frame: where they began.
        begun: what is remembered of that frame; recent: of the last frames, by their number.
    """

    ids: list[int]
    first_frame: int
    begun: Output
    recent: dict[int, Output] = field(default_factory=dict)


class Follower:
    """Follows groups of objects from frame to frame, forwards or backwards."""

    def __init__(self, sam2: Sam2, frames: int) -> None:
        self._model = sam2.video_predictor
        self._frames = frames

    def begin(self, encoded: Encoded, frame: int, ids: list[int], logits: Tensor) -> Group:
        """Objects from masks on one frame: (K, M, M) logits of the model's own masks."""
        side = (self._model.image_size, self._model.image_size)
        masks = F.interpolate(logits[:, None], side, mode="bilinear", align_corners=False) > 0
        features, positions = encoded.repeated(len(ids))
        output = self._model.track_step(
            frame_idx=frame,
            is_init_cond_frame=True,
            current_vision_feats=features,
            current_vision_pos_embeds=positions,
            feat_sizes=encoded.sizes,
            point_inputs=None,
            mask_inputs=masks.float(),
            output_dict={},
            num_frames=self._frames,
            run_mem_encoder=False,
        )
        # As SAM2's predictor does: the memory of a given mask is made of its coarse form, cut at 0.
        high = F.interpolate(output["pred_masks"], side, mode="bilinear", align_corners=False)
        stored, position = self._model._encode_new_memory(
            current_vision_feats=features,
            feat_sizes=encoded.sizes,
            pred_masks_high_res=high,
            object_score_logits=output["object_score_logits"],
            is_mask_from_pts=True,
        )
        return Group(ids, frame, _remembered(stored, position, output))

    def step(self, encoded: Encoded, frame: int, group: Group, reverse: bool) -> Tensor:
        """Where a group's objects are in the next frame: (K, M, M) float32 logits; all below 0 where absent."""
        features, positions = encoded.repeated(len(group.ids))
        output = self._model.track_step(
            frame_idx=frame,
            is_init_cond_frame=False,
            current_vision_feats=features,
            current_vision_pos_embeds=positions,
            feat_sizes=encoded.sizes,
            point_inputs=None,
            mask_inputs=None,
            output_dict={
                "cond_frame_outputs": {group.first_frame: group.begun},
                "non_cond_frame_outputs": group.recent,
            },
            num_frames=self._frames,
            track_in_reverse=reverse,
        )
        stored, position = output["maskmem_features"], output["maskmem_pos_enc"]
        group.recent[frame] = _remembered(stored, position, output)
        self._forget(group, frame)
        return fill_holes(output["pred_masks"][:, 0].float(), self._model.hole_area)

    def _forget(self, group: Group, frame: int) -> None:
        """Drop what the next frames cannot attend to: old masks' memory, and older pointers."""
        for number, output in list(group.recent.items()):
            age = abs(frame - number) + 1
            if age > (self._model.num_maskmem - 1) * self._model.memory_temporal_stride_for_eval:
                output.pop("maskmem_features", None)
                output.pop("maskmem_pos_enc", None)
            if age > self._model.max_obj_ptrs_in_encoder:
                del group.recent[number]


def restarted(group: Group) -> Group:
    """The group as it began, to be followed the other way."""
    return Group(group.ids, group.first_frame, group.begun)


def _remembered(stored: Tensor, position: list[Tensor], output: Output) -> Output:
    # In half the bytes, as SAM2 keeps it; positions are the same for all objects.
    return {
        "maskmem_features": stored.to(torch.bfloat16),
        "maskmem_pos_enc": [each[:1].expand(len(stored), -1, -1, -1) for each in position],
        "obj_ptr": output["obj_ptr"],
    }
