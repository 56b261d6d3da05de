"""PSNR and SSIM agree with torchmetrics, and invalid pixels count in neither; images, masks and label maps of other sizes."""

import math

import numpy as np
import pytest
import torch

from egosplat.image_quality import WINDOW_RADIUS, mean_ssim, psnr, ssim_map
from egosplat.images import resize_image, resize_labels, resize_mask, shrunk_size

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


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_labels_are_taken_under_the_center_of_each_pixel(factor):
    labels = np.arange(24 * 12).reshape(24, 12)
    middle = factor // 2
    assert (resize_labels(labels, 12 // factor, 24 // factor) == labels[middle::factor, middle::factor]).all()


def test_labels_do_not_shift_when_the_sizes_do_not_divide():
    columns = np.broadcast_to(np.arange(100), (100, 100))
    small = resize_labels(columns, 37, 37)
    centers = (np.arange(37) + 0.5) * 100 / 37
    assert (small[0] == np.floor(centers)).all()
    assert (small[0] + small[0][::-1] >= 98).all() and (small[0] + small[0][::-1] <= 100).all()


def test_a_mask_keeps_pixels_that_are_wholly_inside():
    mask = np.ones((30, 30), bool)
    mask[7, 8] = False
    expected = np.ones((20, 20), bool)
    expected[4:6, 5] = False
    # Rows 7..8 of the large mask reach into rows 4 and 5 of the small one, column 8 into column 5 only.
    assert (resize_mask(mask, 20, 20) == expected).all()


def test_areas_are_averaged_and_an_image_of_the_wanted_size_is_not_copied():
    image = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    small = resize_image(image, 20, 15)
    assert np.abs(small - image.reshape(15, 4, 20, 4, 3).mean(axis=(1, 3))).max() <= 0.5
    assert resize_image(image, 80, 60) is image


@pytest.mark.parametrize(
    ("longest", "size"), [(None, (64, 48)), (1000, (64, 48)), (64, (64, 48)), (32, (32, 24)), (1, (1, 1))]
)
def test_the_longer_side_shrinks_and_never_grows(longest, size):
    assert shrunk_size(64, 48, longest) == size
