"""``egosplat export``: a scene in the formats of other programs, read back by these or by libraries that know them."""

import json
import sys

import numpy as np
import pycolmap
import pytest
import trimesh
from gsply import plyread
from gsply.spz import read_spz
from PIL import Image

from egosplat import cli
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.calibration.transforms_json import read_transforms
from tests.support.page_scene import CAMERA, put_page_scene

POSED = [0, 1, 2, 4]
"""Frames of the scene that have a pose."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "scene1"
    folder.mkdir()
    put_page_scene(folder)
    return folder


@pytest.fixture
def export(scene, monkeypatch, capfd):
    """``export(*words)``: exit status, and what it said."""

    def call(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["egosplat", "export", str(scene), *map(str, words)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        return status, capfd.readouterr().err

    return call


def poses(scene) -> np.ndarray:
    return open_artifact(scene / "poses.zarr", POSES).read("camera_to_world")[POSED]


@pytest.mark.parametrize("codes", ["--codes", "--no-codes"])
def test_gaussians_as_ply(scene, export, tmp_path, codes):
    status, said = export("--output", tmp_path / "x.ply", codes)
    assert status == 0 and "700 Gaussians" in said
    assert len(plyread(tmp_path / "x.ply").means) == 700
    assert (b"code_whole_0" in (tmp_path / "x.ply").read_bytes()) == (codes == "--codes")


def test_the_answer_to_a_query(scene, export, tmp_path):
    """The couch is on the left and the cup on the right."""
    for word, side in (("couch", -1), ("cup", 1)):
        status, said = export("--query", word, "--no-codes", "--output", tmp_path / f"{word}.ply")
        assert status == 0, said
        means = plyread(tmp_path / f"{word}.ply").means
        assert 50 < len(means) < 500 and np.median(means[:, 0]) * side > 0.3
    status, said = export("--query", "cup", "--format", "spz", "--output", tmp_path / "cup.spz")
    assert status == 0, said
    assert len(read_spz(tmp_path / "cup.spz").means) == len(means)


def test_a_query_without_an_answer_exports_nothing(scene, export, tmp_path):
    status, said = export("--query", "elephant", "--output", tmp_path / "x.ply")
    assert status == 2 and "elephant" in said and "Traceback" not in said
    assert not (tmp_path / "x.ply").exists()


def test_a_query_needs_gaussians(export, tmp_path):
    status, said = export("--query", "cup", "--format", "colmap", "--output", tmp_path / "x")
    assert status == 2 and "--format ply or spz" in said


def test_instances_as_a_point_cloud(scene, export, tmp_path):
    status, said = export("--format", "instances", "--output", tmp_path / "x.ply")
    assert status == 0, said
    cloud = trimesh.load(tmp_path / "x.ply")
    raw = cloud.metadata["_ply_raw"]["vertex"]["data"]
    owner = raw["instance_whole"].ravel()
    assert len(cloud.vertices) == 700 and owner.max() > 0
    for one in np.unique(owner):
        assert len(np.unique(cloud.colors[owner == one], axis=0)) == 1, "an instance has one color"


def test_nerfstudio_cameras(scene, export, tmp_path):
    status, said = export("--format", "nerfstudio", "--output", tmp_path / "x")
    assert status == 0, said
    found = read_transforms(tmp_path / "x/transforms.json", CAMERA.width, CAMERA.height)
    np.testing.assert_allclose(found.camera_to_world, poses(scene), atol=1e-12)
    assert found.names == [f"images/{frame:06d}.png" for frame in POSED]
    points = open_artifact(scene / "poses.zarr", POSES)
    np.testing.assert_allclose(found.points, points.read("points/xyz"), atol=1e-5)
    rgb = open_artifact(scene / "frames.zarr", FRAMES).row("rgb", 4)
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "x/images/000004.png")), rgb)
    document = json.loads((tmp_path / "x/transforms.json").read_text())
    masks = [frame.get("mask_path") for frame in document["frames"]]
    assert all(name is None or (tmp_path / "x" / name).is_file() for name in masks)


def test_nerfstudio_cameras_in_a_program_for_them(scene, export, tmp_path):
    """NerfBaselines reads nerfstudio's format for many methods. Its release asks for NumPy 1, so CI does not install it."""
    reader = pytest.importorskip(
        "nerfbaselines.datasets.nerfstudio",
        reason="NerfBaselines is absent: pip install --no-deps nerfbaselines",
    )
    status, said = export("--format", "nerfstudio", "--output", tmp_path / "x")
    assert status == 0, said
    folder = str(tmp_path / "x")
    read = [
        reader.load_nerfstudio_dataset(folder, split, features=frozenset()) for split in ("train", "test")
    ]
    found = {
        path: pose
        for one in read
        for path, pose in zip(one["image_paths"], one["cameras"].poses, strict=True)
    }
    assert sorted(path[-10:-4] for path in found) == [f"{frame:06d}" for frame in POSED]
    for (_, pose), truth in zip(sorted(found.items()), poses(scene), strict=True):
        np.testing.assert_allclose(pose, truth[:3], atol=1e-6)
    intrinsics = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])
    np.testing.assert_allclose(read[0]["cameras"].intrinsics[0], intrinsics, rtol=1e-6)
    assert read[0]["cameras"].image_sizes[0].tolist() == [CAMERA.width, CAMERA.height]


def test_colmap_cameras(scene, export, tmp_path):
    status, said = export("--format", "colmap", "--output", tmp_path / "x")
    assert status == 0, said
    model = pycolmap.Reconstruction(tmp_path / "x/sparse/0")
    assert {path.suffix for path in (tmp_path / "x/sparse/0").iterdir()} == {".txt"}
    images = sorted(model.images.values(), key=lambda image: image.name)
    assert [image.name for image in images] == [f"{frame:06d}.png" for frame in POSED]
    for image, pose in zip(images, poses(scene), strict=True):
        np.testing.assert_allclose(image.cam_from_world().inverse().matrix(), pose[:3], atol=1e-9)
    np.testing.assert_allclose(model.cameras[1].calibration_matrix(), CAMERA.matrix)
    assert all((tmp_path / "x/images" / image.name).is_file() for image in images)


def test_the_page(scene, export, tmp_path):
    status, said = export("--format", "html", "--output", tmp_path / "x.html")
    assert status == 0, said
    assert (tmp_path / "x.html").read_text().lower().startswith("<!doctype html>")


def test_a_folder_that_is_there_is_left_alone(export, tmp_path):
    (tmp_path / "x").mkdir()
    status, said = export("--format", "colmap", "--output", tmp_path / "x")
    assert status == 2 and "is there already" in said
    assert not list((tmp_path / "x").iterdir())


@pytest.mark.parametrize("format", ["ply", "spz", "instances", "nerfstudio", "colmap", "html"])
def test_without_artifacts_one_line_says_what_is_missing(tmp_path, monkeypatch, capfd, format):
    monkeypatch.setattr(sys, "argv", ["egosplat", "export", str(tmp_path), "--format", format])
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capfd.readouterr().err
    assert end.value.code == 2 and "lacks" in said and "Traceback" not in said
    assert not list(tmp_path.iterdir())
