"""LERF's pyramid of tiles: its table, and features between tiles."""

import pytest
import torch

from egosplat_rivals.tile_views import at_pixels, pyramid

TABLE = [
    (25, 25, 21),
    (64, 40, 13),
    (102, 51, 11),
    (140, 70, 8),
    (179, 89, 6),
    (217, 108, 5),
    (256, 128, 5),
]


def test_a_square_of_512_pixels_has_the_published_tiles():
    scales = pyramid(512, 512)
    assert [(scale.kernel, scale.stride, scale.rows) for scale in scales] == TABLE
    assert all(scale.rows == scale.columns for scale in scales)


@pytest.mark.parametrize("size", [(512, 512), (704, 704), (1056, 1056), (1408, 1408), (1056, 1889)])
def test_square_frames_have_881_tiles_and_a_wide_one_more(size):
    expected = 881 if size[0] == size[1] else 1550
    assert sum(scale.rows * scale.columns for scale in pyramid(*size)) == expected


def test_a_tiny_frame_still_has_tiles():
    assert all(min(scale.kernel, scale.stride, scale.rows, scale.columns) >= 1 for scale in pyramid(5, 3))


@pytest.mark.parametrize("number", range(7))
def test_constant_features_give_that_constant_everywhere(number):
    scale = pyramid(96, 96)[number]
    pixels = torch.cartesian_prod(torch.arange(0, 96, 5), torch.arange(0, 96, 5))
    found = at_pixels(torch.full((scale.rows, scale.columns, 3), 0.25), scale, pixels)
    assert torch.equal(found, torch.full_like(found, 0.25))


def test_a_tile_s_center_has_its_feature_and_half_way_the_mean():
    scale = pyramid(512, 512)[2]  # side 102, stride 51, first center at -0.5
    tiles = torch.randn(scale.rows, scale.columns, 4, generator=torch.Generator().manual_seed(0))
    odd = pyramid(512, 512)[0]  # side 25, stride 25, first center at 0
    own = torch.randn(odd.rows, odd.columns, 4, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(at_pixels(own, odd, torch.tensor([[75, 50]])), own[2, 3][None])
    between = at_pixels(
        tiles, scale, torch.tensor([[25, 50]])
    )  # columns 0 and 1, half way; row 1 less half a pixel
    part = 50.5 / 51
    rows = torch.lerp(tiles[0, :2], tiles[1, :2], part)
    torch.testing.assert_close(between[0], rows.mean(dim=0))
