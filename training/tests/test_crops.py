"""Crops show the mask's bounding square, and tiles what they are named after, with the right names and looks."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from egosplat.features.crops import fill_hull
from training.small_models import crops as crops_module
from training.small_models.crops import KINDS, OWN_ARMS, Crops, cut_world, plain_name, read_crops
from training.small_models.levels import LEVELS
from training.small_models.patches import (
    INNER_PX,
    LARGEST,
    PATCH_PX,
    SMALLEST,
    cut_patch,
    cut_tile,
    draw_side,
)
from training.small_models.worlds import ClipSettings, read_world, render_world

pytestmark = pytest.mark.slow

SEED = 77


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("worlds") / str(SEED)
    render_world(SEED, ClipSettings(size=96, clips=1, frames=1), made)
    return made


@pytest.fixture(scope="module")
def crops(folder: Path) -> Crops:
    output = folder.parent / "crops.npz"
    cut_world(folder, output)
    return read_crops([output])


@pytest.fixture(scope="module", autouse=True)
def rebuilt_once() -> Iterator[None]:
    """The world is rebuilt for all cuts at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(crops_module, "rebuild_world", cache(crops_module.rebuild_world))
        yield


def test_a_patch_shows_the_mask_in_its_middle() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    mask = np.zeros((200, 300), dtype=bool)
    mask[40:104, 100:148] = True
    patch, side = cut_patch(rgb, mask)
    assert patch.shape == (PATCH_PX, PATCH_PX, 4)
    assert side == 64 == INNER_PX
    # At this size nothing is resized, so pixels equal those of the image.
    margin = (PATCH_PX - INNER_PX) // 2
    np.testing.assert_array_equal(patch[..., :3], rgb[40 - margin : 104 + margin, 124 - 36 : 124 + 36])
    assert patch[..., 3].sum() == 255 * mask.sum()


def test_crops_have_names_of_the_world_s_objects(folder: Path, crops: Crops) -> None:
    world = read_world(folder)
    whole = crops.level == LEVELS.index("whole")
    known = {plain_name(name) for name in world.names} | {OWN_ARMS}
    assert set(crops.names[whole]) <= known
    assert {"wall", "television"} <= set(crops.names[whole])
    assert all("/" in name for name in crops.names[~whole])
    assert set(crops.world) == {SEED}


def test_a_segment_is_the_hull_of_a_mask_and_named_after_what_it_covers_best(folder: Path) -> None:
    world = read_world(folder)
    labels = world.labels(world.subpart[0, 0])
    television = world.names.index("television")
    mask = labels[2] == television
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    corners = np.full(labels.shape, -1, np.int32)
    # Two corners of it as one mask; and a mask that covers next to nothing of anything.
    half = len(columns) // 2
    corners[0][np.ix_(rows, columns[:half])] = np.where(mask[np.ix_(rows, columns[:half])], 7, -1)
    corners[1][rows[0], columns[0]] = 8
    made = folder.parent / "segments.npz"
    cut_world(folder, made, lambda images: iter([corners] * len(images)))
    crops = read_crops([made])
    segments = crops.chosen(crops.kind == KINDS.index("segment"))
    assert len(segments) == 1 and segments.names[0].split("/")[0] == "television"
    assert segments.whole[0] == television and segments.area[0] == (corners[0] == 7).sum()
    inside = segments.patches[0, ..., 3] > 127
    assert (fill_hull(inside) == inside).mean() > 0.98


def test_areas_and_shares_equal_those_of_the_image(folder: Path, crops: Crops) -> None:
    world = read_world(folder)
    objects = crops.kind == KINDS.index("object")
    row = int(np.flatnonzero(objects & (crops.level == LEVELS.index("whole")))[0])
    labels = world.labels(world.subpart[0, crops.frame[row]])
    assert crops.area[row] == (labels[2] == crops.whole[row]).sum()
    assert crops.share[row] == 1
    parts = crops.level < LEVELS.index("whole")
    assert (crops.share[parts] <= 1).all()
    assert (crops.share[parts] > 0).all()
    np.testing.assert_allclose(crops.colors.sum(axis=1), 1, atol=1e-4)


def test_a_tile_has_the_name_of_what_fills_most_of_it(folder: Path, crops: Crops) -> None:
    world = read_world(folder)
    tiles = crops.chosen(crops.kind == KINDS.index("tile"))
    assert len(tiles)
    assert (tiles.level == LEVELS.index("whole")).all()
    assert set(tiles.names) <= {plain_name(name) for name in world.names} | {OWN_ARMS}
    assert (tiles.area >= 0.5 * tiles.side**2).all()
    # The margin is a pixel of the image at least, which is wide around tiles of few pixels.
    middle = slice(PATCH_PX // 4, 3 * PATCH_PX // 4)
    assert (tiles.patches[:, middle, middle, 3] == 255).all(), "a tile has no mask but its square"


def test_a_tile_keeps_the_background_and_is_black_outside_the_image() -> None:
    rgb = np.random.default_rng(0).integers(1, 256, (200, 300, 3), dtype=np.uint8)
    wholes = np.full((200, 300), 7, dtype=np.int32)
    wholes[:, 200:] = 2
    # Columns 148 to 211: 52 of whole 7 and 12 of whole 2.
    patch, shown, area = cut_tile(rgb, wholes, 100, 180, 64)
    assert (shown, area) == (7, 52 * 64)
    np.testing.assert_array_equal(patch[..., :3], rgb[64:136, 144:216])
    patch, shown, area = cut_tile(rgb, wholes, 10, 100, 64)
    assert (shown, area) == (7, 42 * 64)
    assert not patch[:26, :, :3].any()
    assert (patch[4:68, 4:68, 3] == 255).all()


def test_a_tile_of_which_it_is_not_clear_what_it_shows_is_left_out() -> None:
    rgb, wholes = np.zeros((100, 100, 3), dtype=np.uint8), np.full((100, 100), 0, dtype=np.int32)
    wholes[:, 50:] = 1
    assert cut_tile(rgb, wholes, 50, 36, 40) is not None
    assert cut_tile(rgb, wholes, 50, 41, 40) is None, "another whole fills a quarter"
    assert cut_tile(rgb, wholes, 0, 10, 40) is None, "more than half is outside the image"


def test_tiles_have_the_sizes_of_lerf() -> None:
    rng = np.random.default_rng(0)
    sides = [draw_side(512, rng) for _ in range(500)]
    assert SMALLEST * 512 - 1 < min(sides) < 30
    assert 230 < max(sides) < LARGEST * 512 + 1
