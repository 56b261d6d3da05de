"""Worlds for training: levels are nested and connected, images match labels, seeds are disjoint."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from egosplat_apartments.world.world import make_world
from training.small_models import worlds
from training.small_models.levels import find_levels
from training.small_models.worlds import NOTHING, ClipSettings, read_world, render_world

pytestmark = pytest.mark.slow

SCENES = Path(__file__).resolve().parents[2] / "config/scenes.tsv"
TINY = ClipSettings(size=64, clips=2, frames=3, step_s=0.3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("worlds") / "77"
    render_world(77, TINY, made)
    return made


@pytest.fixture(scope="module")
def world():
    return make_world(seed=8, seconds=6.0, objects=18, motion=0.8)


def test_every_subpart_is_a_connected_piece_of_one_part(world):
    levels = find_levels(world)
    geometry = world.geometry
    assert len(levels.face_subpart) == len(geometry.faces)
    for subpart in range(0, len(levels.subpart_part), 7):
        faces = np.flatnonzero(levels.face_subpart == subpart)
        assert set(geometry.face_part[faces]) == {levels.subpart_part[subpart]}
    # Four legs are separate pieces; a table top is one.
    names = np.array(levels.part_names)
    counts = np.bincount(levels.subpart_part, minlength=len(names))
    assert (counts[names == "legs"] == 4).any() and (counts[names == "floor"] == 1).all()


def test_wholes_are_objects_people_and_building_parts(world):
    levels = find_levels(world)
    of_building = [
        name for name, one in zip(levels.whole_names, levels.whole_instance, strict=True) if one == 0
    ]
    assert {"floor", "ceiling", "wall 0", "window", "door", "lamp"} <= set(of_building)
    windows = [number for number, name in enumerate(levels.whole_names) if name == "window"]
    assert len(windows) == len(world.apartment.room.windows)
    for window in windows:
        parts = [levels.part_names[part] for part in np.flatnonzero(levels.part_whole == window)]
        assert sorted(parts) == ["view", "window frame", "window reveal", "window sill"]
    # Every other instance is one whole, with the name of its category.
    rest = [number for number, one in enumerate(levels.whole_instance) if one != 0]
    assert sorted(levels.whole_instance[rest]) == list(range(1, len(world.instances)))
    assert [levels.whole_names[number] for number in rest] == [
        world.instances[levels.whole_instance[number]].category for number in rest
    ]


def test_images_and_labels_have_the_same_shape_and_valid_pixels(folder):
    rendered = read_world(folder)
    assert rendered.rgb.shape == (2, 3, 64, 64, 3) and rendered.rgb.dtype == np.uint8
    assert rendered.subpart.shape == (2, 3, 64, 64)
    labels = rendered.labels(rendered.subpart)
    assert labels.shape == (3, 2, 3, 64, 64)
    nothing = rendered.subpart == NOTHING
    assert (labels[:, nothing] == -1).all() and (labels[:, ~nothing] >= 0).all()
    assert (rendered.rgb[nothing] == 0).all()
    # Levels are nested: each subpart is in one part, and each part in one whole.
    for fine, coarse in ((0, 1), (1, 2)):
        pairs = np.unique(np.stack([labels[fine].ravel(), labels[coarse].ravel()]), axis=1)
        assert len(np.unique(pairs[0])) == pairs.shape[1]
    assert labels[2].max() < len(rendered.names)


def test_edges_of_labels_lie_on_edges_of_the_image(folder):
    """Edges of labels lie on edges of the image far more often than elsewhere."""
    rendered = read_world(folder)
    grey = rendered.rgb[0, 0].astype(np.float64).mean(-1)
    step = np.abs(np.diff(grey, axis=1))
    part = rendered.labels(rendered.subpart[0, 0])[1]
    border = (np.diff(part, axis=1) != 0) & (part[:, 1:] >= 0) & (part[:, :-1] >= 0)
    inside = (np.diff(part, axis=1) == 0) & (part[:, 1:] >= 0)
    assert border.sum() > 50 and step[border].mean() > 2 * step[inside].mean()


def test_the_same_seed_gives_the_same_world(folder, tmp_path):
    render_world(77, TINY, tmp_path / "again")
    for name in ("rgb.npy", "subpart.npy", "world.json"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()
    assert json.loads((folder / "world.json").read_text())["seed"] == 77


def test_homes_have_the_same_things_and_plainer_pictures(folder, tmp_path):
    usual, home = read_world(folder), tmp_path / "home"
    render_world(77, replace(TINY, homes=True), home)
    found = read_world(home)
    assert (found.subpart == usual.subpart).all() and (found.rgb != usual.rgb).mean() > 0.3
    texture = [np.abs(np.diff(one.rgb.astype(int), axis=-2))[:, :, :24].mean() for one in (found, usual)]
    assert texture[0] < texture[1]


def test_seeds_are_far_from_those_of_recordings():
    rows = pd.read_csv(SCENES, sep="\t", comment="#")
    seeds = [
        int(options.partition("synthetic.seed=")[2].split()[0])
        for options in rows[rows.dataset == "adt"].options
    ]
    assert len(set(seeds)) == 20 and max(seeds) < worlds.TRAINING_SEEDS < worlds.HELD_OUT_SEEDS
