"""Artifacts are found from the folder of a scene or a variant alone."""

import shutil

import pytest

from egosplat.artifacts.lineage import locate
from egosplat.errors import UserError

NAMES = ("frames", "splats", "language")


@pytest.fixture
def variant(word_scene):
    """Folder of a variant of a finished scene, without anything in it."""
    folder = word_scene() / "variants" / "mine"
    folder.mkdir(parents=True)
    return folder


def in_folder(folder):
    return [folder / f"{name}.zarr" for name in NAMES]


def test_a_scene_has_its_own(word_scene):
    folder = word_scene()
    assert locate(folder, *NAMES) == in_folder(folder)


def test_what_is_nowhere_would_be_in_the_folder(variant):
    assert locate(variant, *NAMES) == in_folder(variant)


def test_inputs_of_a_variants_codes_are_found_by_digest(variant):
    """Another variant, which this one extends, has the Gaussians; the scene has others of the same name."""
    scene, below = variant.parents[1], variant.parent / "below"
    shutil.move(scene / "language.zarr", variant)
    below.mkdir()
    shutil.move(scene / "splats.zarr", below)
    found = locate(variant, *NAMES, "masks")
    assert found == [
        scene / "frames.zarr",
        below / "splats.zarr",
        variant / "language.zarr",
        variant / "masks.zarr",
    ]


def test_damaged_scores_are_named(variant):
    (variant / "metrics.json").write_text("{")
    with pytest.raises(UserError, match=r"mine/metrics\.json: cannot be read as JSON"):
        locate(variant, "language")
