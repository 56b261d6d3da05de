"""SAM2's masks of many points in one image, without computing for each point what all points share.

SAM2's decoder copies the image for each point, attends to the copies, and enlarges them. Here the first block reads one
image, attention from the image to the few tokens is one matrix product for scores and one for values, and features are
enlarged pixel by pixel, as a linear layer each. The sums are SAM2's in another order, so results agree to rounding.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from sam2.modeling.sam.mask_decoder import MaskDecoder
from sam2.modeling.sam.transformer import Attention, TwoWayTransformer
from torch import Tensor, nn

from egosplat.models.image_encoder import EncodedImage
from egosplat.models.sam2_loader import Sam2


@dataclass(frozen=True, eq=False)
class PointDecoder:
    """Decodes points in one image of (h, w) features; N is h * w.

    Attributes:
        size: h and w.
        image: (1, N, C) features with SAM2's embedding of "no memory" and "no mask".
        positions: (1, N, C) positional encodings.
        middle, fine: (N, 4, C/4) and (N, 4, 4, C/8) features of a pixel's 2 x 2 parts, and of the 2 x 2 parts of these.
    """

    sam2: Sam2
    size: tuple[int, int]
    image: Tensor
    positions: Tensor
    middle: Tensor
    fine: Tensor

    @staticmethod
    def of(sam2: Sam2, encoded: EncodedImage) -> "PointDecoder":
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
        return PointDecoder(
            sam2,
            (height, width),
            _rows(image),
            _rows(encoder.get_dense_pe()),
            middle.permute(1, 3, 2, 4, 0).reshape(height * width, 4, -1),
            fine.permute(1, 4, 2, 5, 3, 6, 0).reshape(height * width, 4, 4, -1),
        )

    def decode(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """(P, 3, 4h, 4w) logits and (P, 3) predicted IoU of the masks of single points.

        Args:
            points: (P, 2) x, y in [0, 1], relative to the image's sides; each is foreground.
        """
        model, device = self.sam2.video_predictor, self.sam2.compute.device
        decoder = model.sam_mask_decoder
        places = (points * model.image_size)[:, None].to(device)
        foreground = torch.ones(len(points), 1, dtype=torch.int32, device=device)
        sparse, _ = model.sam_prompt_encoder(points=(places, foreground), boxes=None, masks=None)
        own = [decoder.obj_score_token.weight] if decoder.pred_obj_scores else []
        own = torch.cat([*own, decoder.iou_token.weight, decoder.mask_tokens.weight])
        tokens = torch.cat([own.expand(len(points), -1, -1), sparse], dim=1)
        attended, image = _two_way(decoder.transformer, self.image, self.positions, tokens)
        first = int(decoder.pred_obj_scores)
        ious = decoder.iou_prediction_head(attended[:, first])
        # Mask 0 is for prompts that are not ambiguous; a point is.
        chosen = range(1, decoder.num_mask_tokens)
        weights = torch.stack(
            [decoder.output_hypernetworks_mlps[mask](attended[:, first + 1 + mask]) for mask in chosen], dim=1
        )
        parts = torch.matmul(weights, self._enlarged(decoder, image).transpose(1, 2))
        return self._arranged(parts), ious[:, 1:]

    def _enlarged(self, decoder: MaskDecoder, image: Tensor) -> Tensor:
        """(P, N, C) -> (P, N * 16, C/8): features of the parts of the parts of each pixel."""
        twice, norm, activation, again, last = decoder.output_upscaling
        middle = _parts(twice, image) + self.middle
        middle = activation(F.layer_norm(middle, middle.shape[-1:], norm.weight, norm.bias, norm.eps))
        return last(_parts(again, middle) + self.fine).flatten(1, 3)

    def _arranged(self, parts: Tensor) -> Tensor:
        """(P, K, N * 16) values of parts of parts -> (P, K, 4h, 4w)."""
        height, width = self.size
        by_part = parts.unflatten(2, (height, width, 2, 2, 2, 2))
        return by_part.permute(0, 1, 2, 4, 6, 3, 5, 7).reshape(*parts.shape[:2], 4 * height, 4 * width)


def _rows(image: Tensor) -> Tensor:
    """(1, C, h, w) -> (1, h * w, C)."""
    return image.flatten(2).transpose(1, 2).contiguous()


def _parts(layer: nn.ConvTranspose2d, values: Tensor) -> Tensor:
    """(..., C) -> (..., 4, D): a transposed convolution of 2 x 2 without overlap is a linear layer for each part."""
    weights = layer.weight.permute(2, 3, 1, 0).flatten(0, 2)
    return F.linear(values, weights, layer.bias.repeat(4)).unflatten(-1, (4, -1))


def _two_way(
    transformer: TwoWayTransformer, image: Tensor, positions: Tensor, tokens: Tensor
) -> tuple[Tensor, Tensor]:
    """Attention between the (P, T, C) tokens of each point and an image of (1, N, C): tokens and image afterwards."""
    queries = tokens
    for layer in transformer.layers:
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
    attention = transformer.final_attn_token_to_image
    queries = queries + _to_image(attention, queries + tokens, image + positions, image)
    return transformer.norm_final_attn(queries), image


def _to_image(attention: Attention, queries: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """Attention of (P, T, C) tokens to images, (P, N, C) each or (1, N, C) for all."""
    if len(keys) == len(queries):
        return attention(q=queries, k=keys, v=values)
    return attention(q=queries.flatten(0, 1)[None], k=keys, v=values)[0].view_as(queries)


def _to_tokens(attention: Attention, queries: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """Attention of images, (P, N, C) each or (1, N, C) for all, to few (P, T, C) tokens: (P, N, C).

    The projections of the image are applied to the tokens instead: to their keys and values of each head.
    """
    heads, (points, count, _) = attention.num_heads, keys.shape
    width = attention.internal_dim // heads
    keys = attention.k_proj(keys).view(points, count, heads, width).transpose(1, 2) / math.sqrt(width)
    values = attention.v_proj(values).view(points, count, heads, width).transpose(1, 2)
    asking = torch.matmul(keys, attention.q_proj.weight.view(heads, width, -1)).flatten(1, 2)
    bias = torch.matmul(keys, attention.q_proj.bias.view(heads, width, 1)).flatten(1, 2)
    scores = torch.matmul(asking, queries.transpose(1, 2)) + bias
    shares = scores.unflatten(1, (heads, count)).softmax(dim=2).flatten(1, 2)
    giving = torch.matmul(values, attention.out_proj.weight.T.reshape(heads, width, -1)).flatten(1, 2)
    return torch.matmul(shares.transpose(1, 2), giving) + attention.out_proj.bias
