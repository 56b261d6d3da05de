"""Propagate masks through a video with SAM2's memory attention, in bounded memory. SAM2's own predictor keeps
the output of every frame for every object. The memory attention uses only an object's first frame and the
last few frames. Only those are kept here, and objects with the same first frame form a batch."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
import torch.nn.functional as F
from sam2.modeling.sam2_base import NO_OBJ_SCORE
from torch import Tensor

from egosplat.artifacts.checkpoint import State
from egosplat.models.point_decoder import EncodedImage
from egosplat.models.sam2_loader import Sam2
from egosplat.models.video_predictor import fill_holes

# Searching in every frame is slower the more objects are out of view.
LOST_STRIDE = 3

# ``maskmem_features`` (K, C, h, w) bfloat16 and ``obj_ptr`` (K, C), as SAM2 names them. Memories of older frames hold
# ``obj_ptr`` only.
Memory = dict[str, Tensor]

Accepts = Callable[[Tensor], Tensor]
"""Decides from the (K, M, M) logits of K objects which masks are of their object: (K,) bool."""


@dataclass
class Group:
    """Objects that start in the same frame, as a batch.

    Attributes:
        ids: instance numbers, in the order of the batch.
        first_frame: the frame in which they start.
        position: (1, C, h, w) positional encoding of memories, the same for all objects and frames.
        begun: memory of the first frame.
        unseen: (K,) frames since each object was last seen; infinite for one that is never searched for again.
        recent: memory of the last frames, by frame.
    """

    ids: list[int]
    first_frame: int
    position: Tensor
    begun: Memory
    unseen: Tensor
    recent: dict[int, Memory] = field(default_factory=dict)

    @staticmethod
    def restored(saved: State, device: torch.device) -> "Group":
        """The group of which ``saved`` are the attributes, on a device."""
        group = Group(**saved)
        group.position = group.position.to(device)
        for memory in (group.begun, *group.recent.values()):
            memory.update({name: values.to(device) for name, values in memory.items()})
        return group

    def end(self, ids: set[int]) -> None:
        """Search for these objects in no later frame, in neither direction."""
        self.unseen[[number in ids for number in self.ids]] = math.inf

    def restart(self) -> None:
        """Go back to the first frame, to be propagated in the other direction; objects that ended stay so."""
        self.recent = {}
        self.unseen[self.unseen < math.inf] = 0


class Propagator:
    """Propagates groups of objects from frame to frame, forwards or backwards."""

    def __init__(
        self,
        sam2: Sam2,
        encoded: Callable[[int], EncodedImage],
        frames: int,
        *,
        lost_tracks_end: bool = False,
    ) -> None:
        """Set up for a video of so many frames. ``encoded``: returns the features of a frame; called for
        those in which an object is searched for. ``lost_tracks_end``: whether to search only in every
        ``LOST_STRIDE``-th frame for what was not seen for as many, and no more for what is out of view for as
        long as SAM2's memory reaches. In other frames it counts as absent and its memory stays as it was."""
        self._model, self._encoded = sam2.video_predictor, encoded
        self._frames, self._stride = frames, LOST_STRIDE if lost_tracks_end else 1
        self._patience = self._model.max_obj_ptrs_in_encoder if lost_tracks_end else math.inf

    def begin(self, frame: int, ids: list[int], logits: Tensor) -> Group:
        """Start a group from the (K, M, M) logits of its objects in one frame, at the size of the model's masks."""
        side = (self._model.image_size, self._model.image_size)
        masks = F.interpolate(logits[:, None], side, mode="bilinear", align_corners=False) > 0
        given = self._inputs(frame, len(ids))
        output = self._model.track_step(
            **given, is_init_cond_frame=True, mask_inputs=masks.float(), output_dict={}, run_mem_encoder=False
        )
        # As in SAM2's predictor: the memory of a given mask is encoded from its low-resolution form.
        high = F.interpolate(output["pred_masks"], side, mode="bilinear", align_corners=False)
        stored, position = self._model._encode_new_memory(
            current_vision_feats=given["current_vision_feats"],
            feat_sizes=given["feat_sizes"],
            pred_masks_high_res=high,
            object_score_logits=output["object_score_logits"],
            is_mask_from_pts=True,
        )
        begun = _memory(stored, output["obj_ptr"])
        return Group(ids, frame, position[-1][:1], begun, torch.zeros(len(ids)))

    def step(self, frame: int, group: Group, reverse: bool, accepts: Accepts | None = None) -> Tensor:
        """Propagate a group to the next frame: (K, M, M) float32 logits; all are below 0 if an object is
        absent. ``accepts``: decides which masks are of their object; the others count as absent and are not
        remembered."""
        count, side = len(group.ids), self._model.image_size // 4
        # SAM2's logit of an absent object, for the objects that are not searched for in this frame.
        logits = group.begun["obj_ptr"].new_full((count, side, side), NO_OBJ_SCORE, dtype=torch.float32)
        # Frame indices, not the age of a track: lost tracks of all groups are then searched for in the same frames.
        patience = self._patience if frame % self._stride == 0 else self._stride
        chosen = (group.unseen < min(patience, self._patience)).nonzero()[:, 0].tolist()
        memory = dict(group.recent.get(frame + 1 if reverse else frame - 1, group.begun))
        if chosen:  # only these objects pass through the model
            found, new = self._track(frame, group, chosen, reverse)
            rows = [*range(len(chosen))] if accepts is None else accepts(found).nonzero()[:, 0].tolist()
            kept = [chosen[row] for row in rows]
            logits[kept] = found[rows]
            if len(kept) == count:
                memory = new
            elif kept:
                for name, values in new.items():
                    memory[name] = memory[name].clone()
                    memory[name][kept] = values[rows].to(memory[name].dtype)
        group.recent[frame] = memory
        seen = (logits > 0).flatten(1).any(1).cpu()
        group.unseen = torch.where(seen, 0, group.unseen + 1)
        self._forget(group, frame)
        return logits

    def searched(self, group: Group) -> int:
        """Number of a group's objects that are searched for again. If none is, the group has no later mask, and needs no memory."""
        return int((group.unseen < self._patience).sum())

    def _inputs(self, frame: int, count: int) -> dict[str, Any]:
        """What SAM2 takes for a batch of objects in a frame."""
        encoded = self._encoded(frame)
        return {
            "frame_idx": frame,
            "current_vision_feats": [features.expand(-1, count, -1) for features in encoded.features],
            "current_vision_pos_embeds": [encoded.positions.expand(-1, count, -1)],
            "feat_sizes": encoded.sizes,
            "point_inputs": None,
            "num_frames": self._frames,
        }

    def _track(self, frame: int, group: Group, chosen: list[int], reverse: bool) -> tuple[Tensor, Memory]:
        """Run SAM2 on the chosen objects of a group: (K, M, M) float32 logits, and the memory of this frame."""

        def for_sam2(memory: Memory) -> dict[str, Any]:
            output: dict[str, Any] = {name: values[chosen] for name, values in memory.items()}
            # A view of one positional encoding costs no memory.
            return output | {"maskmem_pos_enc": [group.position.expand(len(chosen), -1, -1, -1)]}

        output = self._model.track_step(
            **self._inputs(frame, len(chosen)),
            is_init_cond_frame=False,
            mask_inputs=None,
            output_dict={
                "cond_frame_outputs": {group.first_frame: for_sam2(group.begun)},
                "non_cond_frame_outputs": {
                    number: for_sam2(memory) for number, memory in group.recent.items()
                },
            },
            track_in_reverse=reverse,
        )
        masks = fill_holes(output["pred_masks"][:, 0].float(), self._model.hole_area)
        return masks, _memory(output["maskmem_features"], output["obj_ptr"])

    def _forget(self, group: Group, frame: int) -> None:
        """Drop memories that the memory attention of the next frames does not use."""
        if not self.searched(group):
            group.recent.clear()
        for number, memory in list(group.recent.items()):
            age = abs(frame - number) + 1
            # SAM2 attends to the mask memory of few frames, and to the object pointers of more.
            if age > (self._model.num_maskmem - 1) * self._model.memory_temporal_stride_for_eval:
                memory.pop("maskmem_features", None)
            if age > self._model.max_obj_ptrs_in_encoder:
                del group.recent[number]


def _memory(stored: Tensor, pointers: Tensor) -> Memory:
    # bfloat16, as SAM2's predictor keeps them.
    return {"maskmem_features": stored.to(torch.bfloat16), "obj_ptr": pointers}
