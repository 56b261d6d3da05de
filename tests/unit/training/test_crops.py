"""Crops show the mask's bounding square, with the right names and looks."""

from pathlib import Path

import numpy as np
import pytest

from training.small_models.crops import (
    INNER_PX,
    OWN_ARMS,
    PATCH_PX,
    Crops,
    cut_patch,
    cut_world,
    plain_name,
    read_crops,
)
from training.small_models.levels import LEVELS
from training.small_models.worlds import ClipSettings, read_world, render_world

SEED = 31


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rendered world."""
    made = tmp_path_factory.mktemp("worlds") / str(SEED)
    render_world(SEED, ClipSettings(size=96, clips=1, frames=1), made)
    return made


@pytest.fixture(scope="module")
def crops(folder: Path) -> Crops:
    """Crops of the world."""
    output = folder.parent / "crops.npz"
    cut_world(folder, output)
    return read_crops([output])


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


def test_areas_and_shares_equal_those_of_the_image(folder: Path, crops: Crops) -> None:
    world = read_world(folder)
    row = int(np.flatnonzero(crops.level == LEVELS.index("whole"))[0])
    labels = world.labels(world.subpart[0, crops.frame[row]])
    assert crops.area[row] == (labels[2] == crops.whole[row]).sum()
    assert crops.share[row] == 1
    parts = crops.level < LEVELS.index("whole")
    assert (crops.share[parts] <= 1).all()
    assert (crops.share[parts] > 0).all()
    np.testing.assert_allclose(crops.colours.sum(axis=1), 1, atol=1e-4)
