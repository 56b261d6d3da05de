"""Following objects by SAM2's memory, in bounded memory.

SAM2's own predictor keeps, for every object and every frame, what it saw. What its memory attends to is the frame
in which an object began and the few frames before the present one: only those are kept here, and objects that
began together pass through the model together.
"""

from dataclasses import dataclass, field

import torch
import torch.nn.functional as F
from sam2.modeling.sam2_base import NO_OBJ_SCORE
from torch import Tensor

from egosplat.models.mask_holes import fill_holes
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.image_encoder import EncodedImage
from egosplat.segments.memory import Memory, drop_features, make_memory, select_objects, update_memory


@dataclass
class Group:
    """Objects that began in one frame.

    Attributes:
        ids: of the objects, in the order of the batch.
        first_frame: where they began.
        begun: what is remembered of that frame; recent: of the last frames, by their number.
        unseen: for how many frames, up to the last, each object has not been seen.
    """

    ids: list[int]
    first_frame: int
    begun: Memory
    recent: dict[int, Memory] = field(default_factory=dict)
    unseen: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.unseen = [0] * len(self.ids)


class Propagator:
    """Follows groups of objects from frame to frame, forwards or backwards."""

    def __init__(self, sam2: Sam2, frames: int, lost_track_stride: int = 1) -> None:
        """Prepare.

        Args:
            frames: how many the video has.
            lost_track_stride: objects that were not seen for so many frames are looked for in every so manieth frame
                alone; in those between, they are taken for absent and remembered as they were.
        """
        self._model = sam2.video_predictor
        self._frames, self._lost_track_stride = frames, lost_track_stride

    def begin(self, encoded: EncodedImage, frame: int, ids: list[int], logits: Tensor) -> Group:
        """Objects from masks on one frame: (K, M, M) logits of the model's own masks."""
        side = (self._model.image_size, self._model.image_size)
        masks = F.interpolate(logits[:, None], side, mode="bilinear", align_corners=False) > 0
        features, positions = encoded.expand(len(ids))
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
        return Group(ids, frame, make_memory(stored, position, output["obj_ptr"]))

    def step(self, encoded: EncodedImage, frame: int, group: Group, reverse: bool) -> Tensor:
        """Where a group's objects are in the next frame: (K, M, M) float32 logits; all below 0 where absent."""
        count, side = len(group.ids), self._model.image_size // 4
        logits = encoded.features[0].new_full((count, side, side), NO_OBJ_SCORE, dtype=torch.float32)
        chosen = self._searched(group, frame)
        last = group.recent.get(frame + 1 if reverse else frame - 1, group.begun)
        if len(chosen) == count:
            logits, group.recent[frame] = self._track(
                encoded, frame, group.first_frame, group.begun, group.recent, reverse
            )
        elif chosen:
            recent = {number: select_objects(output, chosen) for number, output in group.recent.items()}
            logits[chosen], new = self._track(
                encoded, frame, group.first_frame, select_objects(group.begun, chosen), recent, reverse
            )
            group.recent[frame] = update_memory(last, chosen, new)
        else:
            group.recent[frame] = dict(last)
        seen = (logits > 0).flatten(1).any(1).tolist()
        group.unseen = [0 if one else before + 1 for one, before in zip(seen, group.unseen, strict=True)]
        self._forget(group, frame)
        return logits

    def _searched(self, group: Group, frame: int) -> list[int]:
        """Places in the batch of the objects that are looked for in a frame."""
        stride = self._lost_track_stride
        return [place for place, unseen in enumerate(group.unseen) if unseen < stride or frame % stride == 0]

    def _track(
        self,
        encoded: EncodedImage,
        frame: int,
        first_frame: int,
        begun: Memory,
        recent: dict[int, Memory],
        reverse: bool,
    ) -> tuple[Tensor, Memory]:
        """Logits (K, M, M) of the objects that are remembered, and what is to be remembered of this frame."""
        features, positions = encoded.expand(len(begun["obj_ptr"]))
        output = self._model.track_step(
            frame_idx=frame,
            is_init_cond_frame=False,
            current_vision_feats=features,
            current_vision_pos_embeds=positions,
            feat_sizes=encoded.sizes,
            point_inputs=None,
            mask_inputs=None,
            output_dict={"cond_frame_outputs": {first_frame: begun}, "non_cond_frame_outputs": recent},
            num_frames=self._frames,
            track_in_reverse=reverse,
        )
        new = make_memory(output["maskmem_features"], output["maskmem_pos_enc"], output["obj_ptr"])
        return fill_holes(output["pred_masks"][:, 0].float(), self._model.hole_area), new

    def _forget(self, group: Group, frame: int) -> None:
        """Drop what the next frames cannot attend to: old masks' memory, and older pointers."""
        for number, output in list(group.recent.items()):
            age = abs(frame - number) + 1
            if age > (self._model.num_maskmem - 1) * self._model.memory_temporal_stride_for_eval:
                drop_features(output)
            if age > self._model.max_obj_ptrs_in_encoder:
                del group.recent[number]


def restart(group: Group) -> Group:
    """The group as it began, to be followed the other way."""
    return Group(group.ids, group.first_frame, group.begun)
