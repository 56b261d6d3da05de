"""The lineage of artifacts is found by digest, in their folders and in variants; artifacts are found from a folder alone."""

import shutil
from pathlib import Path

import pytest

from egosplat.artifacts.lineage import lineage, locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, LANGUAGE, POSES, SPLATS
from egosplat.errors import UserError

NAMES = ("frames", "splats", "language")


def move(folder: Path, place: Path, *names: str) -> None:
    place.mkdir(parents=True, exist_ok=True)
    for name in names:
        shutil.move(folder / f"{name}.zarr", place)


def test_inputs_in_the_same_folder_are_found(word_scene):
    folder = word_scene()
    found = lineage([open_artifact(folder / "language.zarr", LANGUAGE)])
    assert [*found.found] == [
        f"{name}.zarr" for name in ("features", "frames", "language", "poses", "splats")
    ]
    assert found.found["poses.zarr"].schema is POSES and found.lost == ()
    shutil.rmtree(folder / "splats.zarr")
    assert lineage([open_artifact(folder / "language.zarr", LANGUAGE)]).lost == ("splats.zarr",)


def test_inputs_are_searched_in_every_folder(word_scene, tmp_path):
    folder, other = word_scene(), tmp_path / "variant"
    move(folder, other, "splats", "language")
    language = open_artifact(other / "language.zarr", LANGUAGE)
    assert lineage([language]).lost == ("features.zarr", "frames.zarr", "poses.zarr")
    found = lineage([language, open_artifact(folder / "poses.zarr", POSES)])
    assert found.lost == () and found.found["splats.zarr"].path.parent == other


def test_inputs_are_looked_for_in_other_variants_of_the_scene(word_scene, tmp_path):
    folder = word_scene()
    own, other = (tmp_path / "scene" / "variants" / name for name in ("own", "other"))
    move(folder, own, "language")
    move(folder, other, "splats")
    artifacts = [
        open_artifact(own / "language.zarr", LANGUAGE),
        open_artifact(folder / "frames.zarr", FRAMES),
    ]
    found = lineage(artifacts)
    assert found.found["splats.zarr"].path.parent == other and found.lost == ()


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


@pytest.fixture
def variant(word_scene) -> Path:
    """Folder of a variant of a finished scene, without anything in it."""
    folder = word_scene() / "variants" / "mine"
    folder.mkdir(parents=True)
    return folder


def test_artifacts_are_located_in_the_scene_and_else_would_be_in_the_folder(variant):
    for folder in (variant.parents[1], variant):
        assert locate(folder, *NAMES) == [folder / f"{name}.zarr" for name in NAMES]
    (variant / "metrics.json").write_text("{")
    with pytest.raises(UserError, match=r"mine/metrics\.json: cannot be read as JSON"):
        locate(variant, "language")


def test_inputs_of_a_variants_codes_are_found_by_digest(variant, tmp_path, monkeypatch):
    """Another variant, which this one extends, has the Gaussians; the scene has others of the same name."""
    scene, below = variant.parents[1], variant.parent / "below"
    move(scene, variant, "language")
    move(scene, below, "splats")
    (link := tmp_path / "link").symlink_to(variant)
    monkeypatch.chdir(variant)
    for own in (variant, link, Path()):
        places = {"frames": scene, "splats": below, "language": own, "masks": own}
        assert locate(own, *places) == [folder / f"{name}.zarr" for name, folder in places.items()]
