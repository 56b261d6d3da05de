"""`egosplat query` and `egosplat export` reject folders that are not finished scenes."""

from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.home import check_scene_folder, title_of

STAGES = ("frames", "poses", "features", "splats", "language")
SCENE = "results/adt/scene1"
DRAFT = f"{SCENE}/variants/draft"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a scene of which frames and poses are made, its variant draft and a README.md."""
    monkeypatch.chdir(tmp_path)
    for name in ("frames", "poses"):
        (tmp_path / SCENE / f"{name}.zarr").mkdir(parents=True)
    (tmp_path / SCENE / "frames.zarr/zarr.json").touch()
    (tmp_path / SCENE / "variants/draft/splats.zarr").mkdir(parents=True)
    (tmp_path / "README.md").touch()
    (tmp_path / "photos").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    "given, said",
    [
        ("README.md", "README.md: is a file; give the folder of a scene"),
        ("photos", "features.zarr, splats.zarr, language.zarr. Give the folder"),
        ("nowhere", "nowhere: does not exist. Give the folder"),
        (f"{SCENE}/frames.zarr", "is a single artifact; give the folder of its scene, results/adt/scene1"),
        (f"{SCENE}/variants/accurate", "does not exist. Make the variant: "),
        (f"{SCENE}/variants/w", "does not exist. "),
        (f"{SCENE}/results/adt/s", f"Make the scene: cd {SCENE} && "),  # below another folder of this name
    ],
)
def test_an_unfinished_scene_lists_its_missing_files(folder, given, said):
    with pytest.raises(UserError) as caught:
        check_scene_folder(Path(given), STAGES)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_variant_may_share_everything(folder):
    for name in ("features", "language"):
        (folder / SCENE / f"variants/w/{name}.zarr").mkdir(parents=True)
    check_scene_folder(folder / SCENE / "variants/w", STAGES)


def test_titles_name_the_scene_and_the_variant(folder):
    assert title_of(folder / SCENE) == "adt/scene1" and title_of(folder / DRAFT) == "adt/scene1, draft"
