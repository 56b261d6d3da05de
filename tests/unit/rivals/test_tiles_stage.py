"""Stage tiles encodes the same tiles after a kill, in any batch size, with and without SAM2's map; LERF's pyramid, and features between tiles."""

from dataclasses import asdict

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS, TILE_SCALES
from egosplat.errors import UserError
from egosplat.features.crops import encode, resize
from egosplat.models.open_clip_loader import load_open_clip
from egosplat_rivals import tiles_stage as stage
from egosplat_rivals.tile_views import at_pixels, pyramid

KEYS = {"regulariser": "none", "sam2_config": "small", "sam2_checkpoint": "small"}
SIZE = 40


@pytest.fixture
def run(clip_keys):
    """``run(folder, name=, **changes)``: the verified artifact."""

    def call(folder, name="tiles.zarr", **changes):
        options = stage.TilesOptions(**KEYS | clip_keys | changes)
        stage.run(folder / "frames.zarr", folder / name, options)
        return verify(folder / name, SCHEMAS)

    return call


def test_each_tile_is_openclip_s_feature_of_what_it_shows(scene, run, clip_keys):
    folder = scene()
    tiles, frames = run(folder), verify(folder / "frames.zarr", SCHEMAS)
    assert tiles.read("frame").tolist() == [0, 1, 2, 3] and not tiles.has("regulariser")
    scales = pyramid(SIZE, SIZE)
    assert tiles.facts["scales"] == [asdict(scale) for scale in scales] and len(scales) == len(TILE_SCALES)
    assert set(tiles.provenance["models"]) == {"clip_checkpoint"}
    clip = load_open_clip(*clip_keys.values())
    scale = scales[6]  # of 20 px, with a stride of 10
    inside = frames.row("rgb", 2)[10:30, :20]
    picture = resize(inside, clip.preprocessing.image_size, clip.preprocessing.interpolation)
    wanted = encode(clip, picture[None])[0]
    # The padding is 10 px: row 2 and column 1 begin at 10 and 0.
    assert (scale.kernel, scale.stride) == (20, 10)
    np.testing.assert_allclose(tiles.read(TILE_SCALES[6])[2, 2, 1], wanted, atol=2e-3)
    with pytest.raises(UserError, match="no frame"):
        run(scene(train=np.zeros(5, bool)))


def test_tiles_beyond_the_border_are_black():
    rgb = np.full((SIZE, SIZE, 3), 200, np.uint8)
    scale = pyramid(SIZE, SIZE)[6]
    tiles = np.stack([*stage.cut_tiles(rgb, scale)])
    assert tiles.shape == (scale.rows * scale.columns, 20, 20, 3)
    assert tiles[0][:10].max() == tiles[0][:, :10].max() == 0 and tiles[0][10:, 10:].min() == 200


def test_batches_and_kills_change_nothing(scene, run, monkeypatch):
    folder = scene()
    whole = run(folder)
    monkeypatch.setattr(stage, "BATCH", 7)
    other = run(folder, "other.zarr")
    monkeypatch.setattr(stage, "BATCH", 128)
    encode_tiles, calls = stage.encode_tiles, []

    def killed(*given):
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return encode_tiles(*given)

    monkeypatch.setattr("egosplat.artifacts.checkpoint.EVERY_S", 0.0)
    monkeypatch.setattr(stage, "encode_tiles", killed)
    with pytest.raises(KeyboardInterrupt):
        run(folder, "resumed.zarr")
    resumed = run(folder, "resumed.zarr")
    assert len(calls) == 3 + 2, "two frames were encoded before the kill"
    assert resumed.digest == whole.digest
    for name in TILE_SCALES:
        np.testing.assert_allclose(other.read(name), whole.read(name), atol=2e-3)


def test_jobs_of_chunks_give_the_same_artifact_with_the_standardised_components_of_sam2(
    scene, run, clip_keys, monkeypatch
):
    """The last chunk has no frame to train on."""
    monkeypatch.setattr("egosplat.pipeline.chunks.CHUNK_FRAMES", 2)
    folder = scene()
    whole = run(folder, "whole.zarr", regulariser="sam2")
    maps = whole.read("regulariser").astype(np.float64)
    assert maps.shape[0] == 4 and maps.shape[1] == maps.shape[2] and 1 <= maps.shape[3] <= 64
    flat = maps.reshape(-1, maps.shape[3])
    np.testing.assert_allclose(flat.mean(axis=0), 0.0, atol=0.05)
    assert (np.diff(flat.var(axis=0)) < 0.05).all(), "the largest components come first"
    assert set(whole.provenance["models"]) == {"clip_checkpoint", "sam2_checkpoint"}
    options = stage.TilesOptions(**KEYS | clip_keys | {"regulariser": "sam2"})
    files = [folder / f"tiles.{number}.chunk" for number in (1, 2, 3)]
    for number, file in enumerate(files, 1):
        stage.run(folder / "frames.zarr", file, options, chunk=number)
    stage.run(folder / "frames.zarr", folder / "tiles.zarr", options, gather=files)
    gathered = verify(folder / "tiles.zarr", SCHEMAS)
    assert gathered.digest == whole.digest and gathered.facts == whole.facts


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
