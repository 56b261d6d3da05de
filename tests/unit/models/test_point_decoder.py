"""Masks of many points are those of SAM2's own decoder, to rounding."""

import numpy as np
import pytest
import torch

from egosplat.compute import choose_compute
from egosplat.models.checkpoints import SMALL, sam2_config_file
from egosplat.models.point_decoder import PointDecoder, encode
from egosplat.models.sam2_loader import Sam2, build_predictor, set_image_size


@pytest.fixture(scope="module", params=[SMALL, "sam2.1_hiera_t"])
def sam2(request) -> Sam2:
    """The small and a published architecture with random weights, also where SAM2 begins with zeros."""
    torch.manual_seed(3)
    predictor = build_predictor(sam2_config_file(request.param)).eval().requires_grad_(False)
    set_image_size(predictor, 128)
    for name, values in predictor.sam_mask_decoder.named_parameters():
        if name.endswith("bias"):
            torch.nn.init.normal_(values, std=0.2)
    return Sam2(predictor, choose_compute("cpu", "float32"))


def decoded_by_sam2(sam2, encoded, points):
    """Logits and predicted IoU from SAM2's own decoder, which copies the image for each point."""
    model = sam2.video_predictor
    places = (points * model.image_size)[:, None]
    foreground = places, torch.ones(len(points), 1, dtype=torch.int32)
    sparse, dense = model.sam_prompt_encoder(points=foreground, boxes=None, masks=None)
    return model.sam_mask_decoder(
        image_embeddings=encoded.image(2) + model.no_mem_embed.reshape(1, -1, 1, 1),
        image_pe=model.sam_prompt_encoder.get_dense_pe(),
        sparse_prompt_embeddings=sparse,
        dense_prompt_embeddings=dense,
        multimask_output=True,
        repeat_image=True,
        high_res_features=[encoded.image(0), encoded.image(1)],
    )[:2]


def decode(decoder, points):
    """Logits and predicted IoU of all masks."""
    attended = decoder.attend(points)
    return decoder.logits(attended), attended.ious


@pytest.mark.parametrize("points", [1, 2, 7])
def test_masks_are_those_of_sam2(sam2, points):
    generator = np.random.default_rng(points)
    image = generator.integers(0, 256, (48, 64, 3), np.uint8)
    places = torch.from_numpy(generator.random((points, 2), np.float32))
    with sam2.compute.inference():
        encoded = encode(sam2, image)
        logits, ious = decode(PointDecoder(sam2, encoded), places)
        expected, expected_ious = decoded_by_sam2(sam2, encoded, places)
    assert logits.shape == expected.shape == (points, 3, 32, 32)
    assert expected.std() > 1e-3, "a decoder without contrast would agree with anything"
    assert torch.allclose(logits, expected, atol=2e-5 * float(expected.abs().max()))
    assert torch.allclose(ious, expected_ious, atol=1e-5)


def test_autocast_keeps_the_residuals(sam2):
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    points = torch.tensor([[0.2, 0.3], [0.7, 0.6]])
    with torch.inference_mode():
        encoded = encode(sam2, image)
        exact, _ = decoded_by_sam2(sam2, encoded, points)
        with torch.autocast("cpu", torch.bfloat16):
            own, _ = decode(PointDecoder(sam2, encoded), points)
            theirs, _ = decoded_by_sam2(sam2, encoded, points)
    error, their_error = ((masks.float() - exact).square().mean() for masks in (own, theirs))
    assert error <= 4 * their_error
