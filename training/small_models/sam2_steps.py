"""Training steps of SAM2 on images and on clips, with the published classes unchanged."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from sam2.modeling.sam2_base import NO_OBJ_SCORE, SAM2Base
from torch import Tensor

from training.small_models.sam2_data import Clip, Prompts, Tracks, to_input
from training.small_models.sam2_losses import Guides, mask_iou, mask_loss

# Weights of subpart, part and whole; a screw is prompted less often than a table.
_LEVEL_WEIGHTS = (0.6, 0.8, 1.2)

_SINGLE_WEIGHT, _PRESENCE_WEIGHT = 0.3, 0.2

# Logits of a mask prompt are plus and minus half of this, as in SAM2.
_GIVEN_SCALE = 20.0


@dataclass(frozen=True, eq=False)
class Encoded:
    """Features of B images: strides 4, 8 and 16, the positional encoding of the last, and the auxiliary loss."""

    features: list[Tensor]
    position: Tensor
    guided: Tensor


@dataclass(frozen=True, eq=False)
class Outcome:
    """Loss of a step, and the mean IoU of its predictions (by level, or by frame)."""

    loss: Tensor
    ious: Tensor


def encode_image(model: SAM2Base, pictures: Tensor) -> tuple[list[Tensor], Tensor, Tensor]:
    """Encode (B, 3, S, S) images.

    Returns:
        Features of strides 4, 8 and 16 for the decoder, the positional encoding of the last, and the features of
        stride 4 before they are projected for the decoder.
    """
    output = model.image_encoder(pictures)
    features = list(output["backbone_fpn"])
    first = features[0]
    features[0] = model.sam_mask_decoder.conv_s0(first)
    features[1] = model.sam_mask_decoder.conv_s1(features[1])
    return features, output["vision_pos_enc"][-1], first


def encode(
    model: SAM2Base, guides: Guides, pictures: Tensor, labels: np.ndarray, names: np.ndarray
) -> Encoded:
    """Encode (B, 3, S, S) images; the auxiliary loss uses (B, 3, S, S) labels and (B, S, S) names."""
    features, position, first = encode_image(model, pictures)
    return Encoded(features, position, guides(first, labels, names))


def decode(
    model: SAM2Base,
    features: Tensor,
    fine: list[Tensor],
    points: Tensor | None = None,
    given: Tensor | None = None,
) -> tuple[Tensor, ...]:
    """Decode masks (B, 4, M, M), IoUs (B, 4), tokens and presence logits (B, 1).

    Args:
        points: (B, 2) prompts; given: (B, 1, M, M) mask prompts. Without either, memory in the features decides.
    """
    count = len(features)
    if points is None:
        place, kind = features.new_zeros(count, 1, 2), -torch.ones(count, 1, dtype=torch.int32)
    else:
        place, kind = points[:, None], torch.ones(count, 1, dtype=torch.int32)
    sparse, dense = model.sam_prompt_encoder(
        points=(place, kind.to(features.device)), boxes=None, masks=given
    )
    return model.sam_mask_decoder.predict_masks(
        image_embeddings=features,
        image_pe=model.sam_prompt_encoder.get_dense_pe(),
        sparse_prompt_embeddings=sparse,
        dense_prompt_embeddings=dense,
        repeat_image=False,
        high_res_features=fine,
    )


def picture_step(
    model: SAM2Base, guides: Guides, balance: float, clips: list[Clip], prompts: list[Prompts]
) -> Outcome:
    """Loss of point prompts on single images: three masks each, and the whole from the single-mask token."""
    device = next(model.parameters()).device
    pictures = torch.cat([to_input(clip.pictures[:1]) for clip in clips]).to(device)
    labels, names = (
        np.stack(each) for each in zip(*((c.labels[:, 0], c.names[0]) for c in clips), strict=True)
    )
    encoded = encode(model, guides, pictures, labels, names)
    count = len(prompts[0].points)
    repeated = [feature.repeat_interleave(count, 0) for feature in encoded.features]
    points, coarse, fine, present = (
        torch.cat([getattr(each, name) for each in prompts]).to(device)
        for name in ("points", "coarse", "fine", "present")
    )
    # Single images have no memory: SAM2 adds this embedding instead of attention to it.
    features = repeated[2] + model.no_mem_embed.view(1, -1, 1, 1)
    masks, ious, _, presence = decode(model, features, repeated[:2], points)
    # The decoder returns the single mask first, whose target is the whole, then the three levels.
    coarse, fine = (torch.cat([each[:, 2:], each], dim=1) for each in (coarse, fine))
    true = mask_iou(masks, fine)
    weights = masks.new_tensor((_SINGLE_WEIGHT, *_LEVEL_WEIGHTS)) * present[:, None]
    loss = (mask_loss(masks, coarse, balance) * weights).sum() / weights.sum().clamp(min=1)
    loss = loss + ((ious - true).square() * present[:, None]).mean()
    loss = loss + _PRESENCE_WEIGHT * F.binary_cross_entropy_with_logits(presence[:, 0], present.float())
    return Outcome(loss + encoded.guided, true[present][:, 1:].mean(0))


def clip_step(
    model: SAM2Base, guides: Guides, balance: float, clips: list[Clip], tracks: list[Tracks]
) -> Outcome:
    """Loss of masks that are given in the first frame and propagated through the others by memory."""
    device = next(model.parameters()).device
    frames = len(clips[0].pictures)
    pictures = torch.cat([to_input(clip.pictures) for clip in clips]).to(device)
    labels = np.concatenate([clip.labels.swapaxes(0, 1) for clip in clips])
    encoded = encode(model, guides, pictures, labels, np.concatenate([clip.names for clip in clips]))
    counts = torch.tensor([len(each.prompt) for each in tracks], device=device)
    by_frame = [feature.unflatten(0, (len(clips), frames)) for feature in encoded.features]
    position = encoded.position.unflatten(0, (len(clips), frames))[:, 0].repeat_interleave(counts, 0)
    prompt = torch.cat([each.prompt for each in tracks]).to(device)
    coarse, fine, present = (
        torch.cat([getattr(each, name) for each in tracks], dim=1).to(device)
        for name in ("coarse", "fine", "present")
    )
    memory: dict[str, dict[int, dict[str, Tensor]]] = {"cond_frame_outputs": {}, "non_cond_frame_outputs": {}}
    losses, ious = [], []
    for frame in range(frames):
        at = [feature[:, frame].repeat_interleave(counts, 0) for feature in by_frame]
        if frame == 0:
            memory["cond_frame_outputs"][0], masks, presence = _begin(model, at, prompt)
            losses.append(_SINGLE_WEIGHT * mask_loss(masks, coarse[0], balance).mean())
            losses.append(
                _PRESENCE_WEIGHT * F.binary_cross_entropy_with_logits(presence, torch.ones_like(presence))
            )
            continue
        masks, predicted, presence, kept = _follow(model, at, position, memory, frame, frames)
        memory["non_cond_frame_outputs"][frame] = kept
        seen, true = present[frame].float(), mask_iou(masks, fine[frame])
        share = seen.sum().clamp(min=1)
        losses.append((mask_loss(masks, coarse[frame], balance) * seen).sum() / share)
        losses.append(((predicted - true).square() * seen).sum() / share)
        losses.append(2 * _PRESENCE_WEIGHT * F.binary_cross_entropy_with_logits(presence, seen))
        ious.append((true * seen).sum() / share)
    return Outcome(torch.stack(losses).sum() / (frames - 1) + encoded.guided, torch.stack(ious))


def _tokens(feature: Tensor) -> Tensor:
    """(B, C, h, w) -> (h * w, B, C)."""
    return feature.flatten(2).permute(2, 0, 1)


def _begin(
    model: SAM2Base, features: list[Tensor], prompt: Tensor
) -> tuple[dict[str, Tensor], Tensor, Tensor]:
    """Memory of a mask prompt, built like ``SAM2Base._use_mask_as_output``; the decoder's masks and presence."""
    # The presence logits need a loss: else the decoder would use the object pointer of absent objects.
    masks, _, tokens, presence = decode(model, features[2], features[:2], given=model.mask_downsample(prompt))
    pointer = _pointer(model, tokens, presence)
    logits = prompt * _GIVEN_SCALE - _GIVEN_SCALE / 2
    sure = torch.full_like(presence, _GIVEN_SCALE / 2)
    kept = _remember(model, features[2], logits, sure, pointer, given=True)
    return kept, masks[:, 0], presence[:, 0]


def _pointer(model: SAM2Base, tokens: Tensor, presence: Tensor) -> Tensor:
    """(B, C) object pointer of the memory, or the one for an absent object."""
    return torch.where(presence > 0, model.obj_ptr_proj(tokens[:, 0]), model.no_obj_ptr)


def _follow(
    model: SAM2Base,
    features: list[Tensor],
    position: Tensor,
    memory: dict[str, dict[int, dict[str, Tensor]]],
    frame: int,
    frames: int,
) -> tuple[Tensor, Tensor, Tensor, dict[str, Tensor]]:
    """Masks (B, M, M), predicted IoU (B,), presence logits (B,) of a frame, and its memory."""
    side = features[2].shape[-1]
    conditioned = model._prepare_memory_conditioned_features(
        frame_idx=frame,
        is_init_cond_frame=False,
        current_vision_feats=[_tokens(features[2])],
        current_vision_pos_embeds=[_tokens(position)],
        feat_sizes=[(side, side)],
        output_dict=memory,
        num_frames=frames,
    )
    masks, ious, tokens, presence = decode(model, conditioned, features[:2])
    pointer = _pointer(model, tokens, presence)
    # As in SAM2, the memory of an absent object holds no mask.
    gated = torch.where((presence > 0)[:, :, None, None], masks[:, :1], NO_OBJ_SCORE)
    high = F.interpolate(gated, (model.image_size,) * 2, mode="bilinear", align_corners=False)
    kept = _remember(model, features[2], high, presence, pointer, given=False)
    return masks[:, 0], ious[:, 0], presence[:, 0], kept


def _remember(
    model: SAM2Base, features: Tensor, high: Tensor, presence: Tensor, pointer: Tensor, given: bool
) -> dict[str, Tensor]:
    side = features.shape[-1]
    stored, position = model._encode_new_memory([_tokens(features)], [(side, side)], high, presence, given)
    return {"maskmem_features": stored, "maskmem_pos_enc": position, "obj_ptr": pointer}
