"""SAM2's image encoder, run once per image, and its masks of many points, without computing for each what all points share.

SAM2's decoder copies the image for each point, attends to the copies, and enlarges them. Here the first block reads one
image, projections of the image are applied to the few tokens that attend to it instead, and features are enlarged pixel
by pixel, as a linear layer each. The sums are SAM2's in another order, so results agree to rounding.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from sam2.modeling.sam.transformer import Attention, TwoWayTransformer
from torch import Tensor, nn

from egosplat.arrays import Bytes
from egosplat.models.sam2_loader import Sam2

# Mean and standard deviation of ImageNet, with which SAM2 was trained.
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class EncodedImage:
    """Features of one image from SAM2's encoder.

    Attributes:
        features: (h * w, 1, C) each, finest first, as ``SAM2Base.track_step`` takes them.
        positions: (h * w, 1, C) of the coarsest; it takes no others.
        sizes: (h, w) of each.
    """

    features: list[Tensor]
    positions: Tensor
    sizes: list[tuple[int, int]]

    def image(self, level: int) -> Tensor:
        """(1, C, h, w) features of one level."""
        feature = self.features[level]
        return feature.permute(1, 2, 0).reshape(1, feature.shape[2], *self.sizes[level])


def encode(sam2: Sam2, image: Bytes) -> EncodedImage:
    """Run the image encoder on a (H, W, 3) uint8 RGB image, resized to the model's square."""
    model = sam2.video_predictor
    values = torch.tensor(image, device=sam2.compute.device).permute(2, 0, 1)[None].float() / 255
    # SAM2 stretches images to a square, whatever their aspect.
    side = (model.image_size, model.image_size)
    values = F.interpolate(values, side, mode="bilinear", antialias=True, align_corners=False)
    mean, std = (torch.tensor(each, device=values.device)[:, None, None] for each in (_MEAN, _STD))
    encoded = model.forward_image((values - mean) / std)
    _, features, positions, sizes = model._prepare_backbone_features(encoded)
    return EncodedImage(list(features), positions[-1], [tuple(size) for size in sizes])


@dataclass(frozen=True, eq=False)
class Attended:
    """P points after attention: (P, N, C) features of the image as each sees it, (P, 3, C/8) weights whose products with
    enlarged features are logits, and (P, 3) predicted IoU of the masks."""

    image: Tensor
    weights: Tensor
    ious: Tensor

    def take(self, points: Tensor) -> "Attended":
        """Select points by (K,) indices."""
        return Attended(self.image[points], self.weights[points], self.ious[points])


class PointDecoder:
    """Decodes points in one image of (h, w) features; N is h * w. A mask has 4 x 4 cells in each of these N pixels.

    Attributes:
        image, positions: (N, C) features with SAM2's embedding of "no memory" and "no mask"; positional encodings.
        middle, fine: (N, 4, C/4) and (N, 4, 4, C/8) features of a pixel's 2 x 2 parts, and of the 2 x 2 parts of these.
        cells: (4h, 4w) place of each cell of a mask among the N * 16 parts of the parts of pixels.
    """

    def __init__(self, sam2: Sam2, encoded: EncodedImage) -> None:
        """Prepare the features of an encoded image."""
        model, image = sam2.video_predictor, encoded.image(2)
        encoder = model.sam_prompt_encoder
        # An image without memory gets SAM2's embedding of "no memory", as in its image predictor.
        if model.directly_add_no_mem_embed:
            image = image + model.no_mem_embed.reshape(1, -1, 1, 1)
        image = image + encoder.no_mask_embed.weight.reshape(1, -1, 1, 1)
        height, width = image.shape[-2:]
        middle = encoded.image(1)[0].unflatten(1, (height, 2)).unflatten(3, (width, 2))
        fine = encoded.image(0)[0].unflatten(1, (height, 2, 2)).unflatten(4, (width, 2, 2))
        parts = torch.arange(16 * height * width, device=image.device)
        parts = parts.unflatten(0, (height, width, 2, 2, 2, 2)).permute(0, 2, 4, 1, 3, 5)
        self.sam2, self.image, self.positions = sam2, _rows(image), _rows(encoder.get_dense_pe())
        self.middle = middle.permute(1, 3, 2, 4, 0).reshape(height * width, 4, -1)
        self.fine = fine.permute(1, 4, 2, 5, 3, 6, 0).reshape(height * width, 4, 4, -1)
        self.cells = parts.reshape(4 * height, 4 * width)

    def attend(self, points: Tensor) -> Attended:
        """Let (P, 2) single foreground points, x and y in [0, 1] of the image's sides, attend to the image, and it to them."""
        model, device = self.sam2.video_predictor, self.sam2.compute.device
        decoder: Any = model.sam_mask_decoder
        places = (points * model.image_size)[:, None].to(device)
        foreground = torch.ones(len(points), 1, dtype=torch.int32, device=device)
        sparse, _ = model.sam_prompt_encoder(points=(places, foreground), boxes=None, masks=None)
        own = [decoder.obj_score_token.weight] if decoder.pred_obj_scores else []
        own = torch.cat([*own, decoder.iou_token.weight, decoder.mask_tokens.weight])
        tokens = torch.cat([own.expand(len(points), -1, -1), sparse], dim=1)
        # Mask 0 is for prompts that are not ambiguous; a point is.
        chosen, first = range(1, decoder.num_mask_tokens), int(decoder.pred_obj_scores)
        read = [first, *(first + 1 + mask for mask in chosen)]
        attended, image = _two_way(decoder.transformer, self.image, self.positions, tokens, read)
        weights = [decoder.output_hypernetworks_mlps[mask](attended[:, mask]) for mask in chosen]
        ious = decoder.iou_prediction_head(attended[:, 0])[:, 1:]
        return Attended(image, torch.stack(weights, dim=1), ious)

    def logits(self, attended: Attended) -> Tensor:
        """(P, 3, 4h, 4w) logits of the masks."""
        upscaling: Any = self.sam2.video_predictor.sam_mask_decoder.output_upscaling
        twice, norm, activation, again, last = upscaling
        middle = _parts(twice, attended.image, self.middle)
        middle = activation(F.layer_norm(middle, middle.shape[-1:], norm.weight, norm.bias, norm.eps))
        fine = last(_parts(again, middle, self.fine))
        parts = torch.matmul(attended.weights, fine.flatten(1, 3).transpose(1, 2))
        cells = self.cells.flatten().expand(*parts.shape[:2], -1)
        return parts.gather(2, cells).unflatten(2, self.cells.shape)


def _rows(image: Tensor) -> Tensor:
    """(1, C, h, w) -> (h * w, C)."""
    return image[0].flatten(1).T.contiguous()


def _parts(layer: nn.ConvTranspose2d, values: Tensor, more: Tensor) -> Tensor:
    """(..., C) -> (..., 4, D): a transposed convolution of 2 x 2 without overlap is a linear layer for each part; plus ``more``."""
    weights = layer.weight.permute(2, 3, 1, 0).flatten(0, 2)
    # In place, because the largest tensors of the decoder are the dearest to allocate.
    assert layer.bias is not None
    return F.linear(values, weights).float().unflatten(-1, (4, -1)).add_(more + layer.bias)


def _two_way(
    transformer: TwoWayTransformer, image: Tensor, positions: Tensor, tokens: Tensor, read: list[int]
) -> tuple[Tensor, Tensor]:
    """Attention between (P, T, C) tokens and an image of (N, C): (P, R, C) the tokens to ``read``, and (P, N, C) images
    afterwards."""
    queries = tokens
    layers: Any = transformer.layers
    for layer in layers:
        if layer.skip_first_layer_pe:
            queries = layer.norm1(layer.self_attn(q=queries, k=queries, v=queries))
        else:
            asked = queries + tokens
            queries = layer.norm1(queries + layer.self_attn(q=asked, k=asked, v=queries))
        placed = image + positions
        queries = layer.norm2(
            queries + _to_image(layer.cross_attn_token_to_image, queries + tokens, placed, image)
        )
        queries = layer.norm3(queries + layer.mlp(queries))
        image = layer.norm4(
            image + _to_tokens(layer.cross_attn_image_to_token, placed, queries + tokens, queries)
        )
    queries, tokens = queries[:, read], tokens[:, read]
    attention = transformer.final_attn_token_to_image
    queries = queries + _to_image(attention, queries + tokens, image + positions, image)
    return transformer.norm_final_attn(queries), image


def _to_image(attention: Attention, queries: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """Attention of (P, T, C) tokens to images, (P, N, C) each or (N, C) for all: (P, T, C)."""
    if keys.ndim == 2:
        return attention(q=queries.flatten(0, 1)[None], k=keys[None], v=values[None])[0].view_as(queries)
    asking, _ = _folded(attention, attention.q_proj(queries), attention.k_proj)
    # The bias of the keys changes all scores of a token alike, so their softmax not at all.
    shares = torch.matmul(asking, keys.transpose(1, 2)).softmax(dim=2)
    seen = torch.matmul(shares, values).unflatten(1, (attention.num_heads, -1))
    weights = attention.v_proj.weight.unflatten(0, (attention.num_heads, -1))
    found = torch.matmul(seen, weights.transpose(1, 2)).transpose(1, 2).flatten(2)
    return attention.out_proj(found + attention.v_proj.bias)


def _to_tokens(attention: Attention, queries: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """Attention of images, (P, N, C) each or (N, C) for all, to few (P, T, C) tokens: (P, N, C)."""
    heads = attention.num_heads
    asking, bias = _folded(attention, attention.k_proj(keys), attention.q_proj)
    scores = torch.matmul(asking, queries.transpose(-2, -1)) + bias
    shares = scores.unflatten(1, (heads, -1)).softmax(dim=2).flatten(1, 2)
    values = attention.v_proj(values).unflatten(2, (heads, -1)).transpose(1, 2)
    weights = attention.out_proj.weight.T.unflatten(0, (heads, -1))
    giving = torch.matmul(values, weights).flatten(1, 2)
    return torch.matmul(shares.transpose(1, 2), giving) + attention.out_proj.bias


def _folded(attention: Attention, tokens: Tensor, projection: nn.Linear) -> tuple[Tensor, Tensor]:
    """Apply the projection of an image to (P, T, D) projected tokens instead, by head and scaled: (P, H * T, C) whose products
    with features of the image, plus (P, H * T, 1), are scores."""
    tokens = tokens.unflatten(2, (attention.num_heads, -1)).transpose(1, 2)
    tokens = tokens / math.sqrt(tokens.shape[3])
    weights, bias = (each.unflatten(0, (attention.num_heads, -1)) for each in projection.parameters())
    return torch.matmul(tokens, weights).flatten(1, 2), torch.matmul(tokens, bias[..., None]).flatten(1, 2)
