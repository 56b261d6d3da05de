"""PSNR and SSIM agree with torchmetrics, and invalid pixels count in neither."""

import math

import numpy as np
import pytest
import torch

from egosplat.image_quality import WINDOW_RADIUS, mean_ssim, psnr, ssim_map

HEIGHT, WIDTH = 30, 40
EVERYWHERE = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)


def picture(seed: int) -> torch.Tensor:
    """(30, 40, 3) uint8 noise from 50 to 199."""
    values = np.random.default_rng(seed).integers(50, 200, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    return torch.from_numpy(values)


def planar(one: torch.Tensor) -> torch.Tensor:
    return one.permute(2, 0, 1)[None].double() / 255.0


def ssim(render: torch.Tensor, photograph: torch.Tensor, valid: torch.Tensor) -> float:
    return mean_ssim(ssim_map(render, photograph, valid), valid)


def test_ssim_is_torchmetrics_where_windows_are_whole():
    from torchmetrics.functional.image import structural_similarity_index_measure

    render, photograph = picture(0), picture(1)
    _, full = structural_similarity_index_measure(
        planar(render), planar(photograph), data_range=1.0, return_full_image=True
    )
    found = ssim_map(render, photograph, EVERYWHERE)
    inner = found[WINDOW_RADIUS:-WINDOW_RADIUS, WINDOW_RADIUS:-WINDOW_RADIUS]
    expected = full[0].mean(dim=0)[WINDOW_RADIUS:-WINDOW_RADIUS, WINDOW_RADIUS:-WINDOW_RADIUS]
    assert torch.allclose(inner.double(), expected, atol=1e-5)
    assert int(found.isnan().sum()) == HEIGHT * WIDTH - inner.numel()
    assert mean_ssim(found, EVERYWHERE) == pytest.approx(float(expected.mean()), abs=1e-5)


def test_invalid_pixels_count_in_neither_score():
    """Whatever they show: the scores are those of the valid part cut out of the picture."""
    render, photograph = picture(0), picture(1)
    valid = EVERYWHERE.clone()
    valid[:, :12] = False
    for filling in (render, photograph, torch.zeros_like(render)):
        shown = torch.where(valid[..., None], render, filling)
        cut = shown[:, 12:], photograph[:, 12:], valid[:, 12:]
        assert psnr(shown, photograph, valid) == psnr(*cut)
        assert ssim(shown, photograph, valid) == pytest.approx(ssim(*cut), abs=1e-6)


def test_a_window_with_an_invalid_pixel_has_no_value():
    valid = EVERYWHERE.clone()
    valid[15, 20] = False
    found = ssim_map(picture(0), picture(1), valid)
    reach = WINDOW_RADIUS
    assert found[15 - reach : 16 + reach, 20 - reach : 21 + reach].isnan().all()
    assert not found[15, 21 + reach].isnan() and not found[16 + reach, 20].isnan()


def test_scores_of_equal_images_and_of_a_known_error():
    one = picture(0)
    assert psnr(one, one, EVERYWHERE) == math.inf
    assert ssim(one, one, EVERYWHERE) == pytest.approx(1.0, abs=1e-6)
    flat = torch.full((HEIGHT, WIDTH, 3), 100, dtype=torch.uint8)
    expected = 20 * math.log10(255 / 20)
    assert psnr(flat + 20, flat, EVERYWHERE) == pytest.approx(expected, abs=1e-9)
    # Differences of uint8 must not wrap round.
    assert psnr(flat, flat + 20, EVERYWHERE) == pytest.approx(expected, abs=1e-9)


def test_constant_images_have_an_ssim():
    black = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.uint8)
    assert ssim(black, black, EVERYWHERE) == pytest.approx(1.0)
    assert 0.0 <= ssim(black, black + 255, EVERYWHERE) < 0.01


@pytest.mark.parametrize(
    "height, width, valid", [(10, 40, True), (1, 1, True), (11, 10, True), (30, 40, False)]
)
def test_an_image_smaller_than_a_window_or_without_a_valid_pixel_has_no_ssim(height, width, valid):
    one, where = torch.zeros(height, width, 3, dtype=torch.uint8), torch.full((height, width), valid)
    assert math.isnan(ssim(one, one, where))
    assert psnr(one, one, where) == math.inf if valid else math.isnan(psnr(one, one, where))
