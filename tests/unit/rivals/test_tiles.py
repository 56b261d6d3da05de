"""LERF's pyramid of tiles: its table, and features between tiles."""

import torch

from egosplat_rivals.tile_views import at_pixels, pyramid

SIDES = [(25, 25, 21), (64, 40, 13), (102, 51, 11), (140, 70, 8), (179, 89, 6), (217, 108, 5), (256, 128, 5)]


def test_square_frames_have_the_published_tiles_and_a_wide_one_more():
    scales = pyramid(512, 512)
    assert [(scale.kernel, scale.stride, scale.rows) for scale in scales] == SIDES
    assert all(scale.rows == scale.columns for scale in scales)
    for size, expected in (((704, 704), 881), ((1056, 1056), 881), ((1408, 1408), 881), ((1056, 1889), 1550)):
        assert sum(scale.rows * scale.columns for scale in pyramid(*size)) == expected


def test_a_tiny_frame_still_has_tiles():
    assert all(min(scale.kernel, scale.stride, scale.rows, scale.columns) >= 1 for scale in pyramid(5, 3))


def test_constant_features_give_that_constant_everywhere():
    pixels = torch.cartesian_prod(torch.arange(0, 96, 5), torch.arange(0, 96, 5))
    for scale in pyramid(96, 96):
        found = at_pixels(torch.full((scale.rows, scale.columns, 3), 0.25), scale, pixels)
        assert torch.equal(found, torch.full_like(found, 0.25))


def test_a_tile_s_center_has_its_feature_and_half_way_the_mean():
    odd, _, even, *_ = pyramid(512, 512)
    draw = torch.Generator().manual_seed(0)
    # Side 25, stride 25, first center at 0.
    tiles = torch.randn(odd.rows, odd.columns, 4, generator=draw)
    torch.testing.assert_close(at_pixels(tiles, odd, torch.tensor([[75, 50]])), tiles[2, 3][None])
    # Side 102, stride 51, first center at -0.5: columns 0 and 1, half way; row 1 less half a pixel.
    tiles = torch.randn(even.rows, even.columns, 4, generator=draw)
    rows = torch.lerp(tiles[0, :2], tiles[1, :2], 50.5 / 51)
    torch.testing.assert_close(at_pixels(tiles, even, torch.tensor([[25, 50]]))[0], rows.mean(dim=0))
