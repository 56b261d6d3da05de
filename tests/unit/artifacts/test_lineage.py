"""The lineage of artifacts is found in their folders and in variants, by digest."""

import shutil

import pytest

from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.reader import open_any, open_artifact
from egosplat.artifacts.schemas import LANGUAGE, POSES, SCHEMAS, SPLATS
from egosplat.errors import UserError


def test_inputs_in_the_same_folder_are_found(word_scene):
    language = open_artifact(word_scene() / "language.zarr", LANGUAGE)
    found = lineage([language])
    assert list(found.found) == [
        f"{name}.zarr" for name in ("features", "frames", "language", "poses", "splats")
    ]
    assert found.found["poses.zarr"].schema is POSES and found.lost == ()


def test_inputs_are_searched_in_every_folder(word_scene, tmp_path):
    folder, other = word_scene(), tmp_path / "variant"
    for name in ("splats", "language"):
        shutil.move(folder / f"{name}.zarr", other / f"{name}.zarr")
    language = open_artifact(other / "language.zarr", LANGUAGE)
    assert lineage([language]).lost == ("features.zarr", "frames.zarr", "poses.zarr")
    found = lineage([language, open_artifact(folder / "poses.zarr", POSES)])
    assert found.lost == () and found.found["splats.zarr"].path.parent == other


def test_a_missing_input_is_reported_lost(word_scene):
    folder = word_scene()
    shutil.rmtree(folder / "splats.zarr")
    assert lineage([open_artifact(folder / "language.zarr", LANGUAGE)]).lost == ("splats.zarr",)


def test_an_artifact_made_from_another_is_named(word_scene, tmp_path):
    other = shutil.copytree(word_scene(nudge=0.001) / "language.zarr", tmp_path / "other")
    folder = word_scene()
    shutil.rmtree(folder / "language.zarr")
    shutil.copytree(other, folder / "language.zarr")
    language = open_artifact(folder / "language.zarr", LANGUAGE)
    # The same folder holds another artifact of this name, with another digest.
    assert lineage([language]).lost == ("splats.zarr",)
    with pytest.raises(UserError, match=r"language.zarr: was made from another splats.zarr .*Rebuild it: "):
        lineage([language, open_artifact(folder / "splats.zarr", SPLATS)])


def test_inputs_are_looked_for_in_other_variants_of_the_scene(word_scene, tmp_path):
    folder = word_scene()
    own, other = (tmp_path / "scene" / "variants" / name for name in ("own", "other"))
    for name, place in (("language", own), ("splats", other)):
        place.mkdir(parents=True)
        shutil.move(folder / f"{name}.zarr", place / f"{name}.zarr")
    language = open_artifact(own / "language.zarr", LANGUAGE)
    frames = open_any(folder / "frames.zarr", SCHEMAS)
    found = lineage([language, frames])
    assert found.found["splats.zarr"].path.parent == other and found.lost == ()
