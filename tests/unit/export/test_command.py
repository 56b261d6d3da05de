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

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.calibration.transforms_json import read_transforms
from tests.support.commands import run_command
from tests.support.page_scene import CAMERA

POSED = [0, 1, 2, 4]
"""Frames of the scene that have a pose."""


@pytest.fixture
def export(page_scene, monkeypatch, capfd):
    """``export(*words)``: exit status, and what it said."""

    def call(*words: object) -> tuple[int, str]:
        return run_command(monkeypatch, capfd, "export", page_scene, *words)[::2]

    return call


def poses(scene) -> np.ndarray:
    return open_artifact(scene / "poses.zarr", POSES).read("camera_to_world")[POSED]


@pytest.mark.parametrize("codes", ["--codes", "--no-codes"])
def test_gaussians_as_ply(export, tmp_path, codes):
    status, said = export("--output", tmp_path / "x.ply", codes)
    assert status == 0 and "700 Gaussians" in said
    assert len(plyread(tmp_path / "x.ply").means) == 700
    assert (b"code_whole_0" in (tmp_path / "x.ply").read_bytes()) == (codes == "--codes")


def test_the_answer_to_a_query(export, tmp_path):
    for word, side in (("couch", -1), ("cup", 1)):
        status, said = export("--query", word, "--no-codes", "--output", tmp_path / f"{word}.ply")
        assert status == 0, said
        means = plyread(tmp_path / f"{word}.ply").means
        assert 50 < len(means) < 500 and np.median(means[:, 0]) * side > 0.3
    status, said = export("--query", "cup", "--format", "spz", "--output", tmp_path / "cup.spz")
    assert status == 0, said
    assert len(read_spz(tmp_path / "cup.spz").means) == len(means)


def rows_of(path) -> dict[str, list[dict]]:
    """The rows of each entity, as Rerun reads them."""
    rows: dict[str, list[dict]] = {}
    for chunk in pytest.importorskip("rerun.experimental").RrdReader(path).stream().to_chunks():
        rows.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pylist())
    return rows


def test_rerun_reads_its_recording(page_scene, export, tmp_path):
    status, said = export("--query", "couch, elephant", "--output", tmp_path / "scene.rrd")
    assert status == 0 and "4 frames, 2 answers" in said
    rows = rows_of(tmp_path / "scene.rrd")
    placed = {row["frame"]: row for row in rows["/world/camera"] if row.get("frame") is not None}
    found = [np.ravel(placed[frame]["Transform3D:translation"]) for frame in POSED]
    assert sorted(placed) == POSED and np.allclose(found, poses(page_scene)[:, :3, 3])
    turn = np.reshape(placed[POSED[-1]]["Transform3D:mat3x3"], (3, 3), order="F")
    assert np.allclose(turn, poses(page_scene)[-1, :3, :3], atol=1e-6)
    assert len(rows["/world/camera/picture"]) == len(rows["/world/camera/instances"]) == len(POSED)
    names = ("gaussians", "answers/couch", "answers/elephant")
    (points,), (couch,), (elephant,) = (rows[f"/world/{name}"] for name in names)
    assert 0 < len(points["Points3D:positions"]) <= 700
    assert couch["Boxes3D:centers"][0][0] < -0.3 and couch["Boxes3D:labels"][0].startswith("couch 0.")
    assert not elephant["Boxes3D:centers"]


@pytest.mark.parametrize(
    "words, said",
    [
        (("--output", "x.rrd"), 'pip install "egosplat[rerun]"'),
        (("--query", "elephant", "--output", "x.ply"), "elephant"),
        (("--query", "cup", "--format", "colmap", "--output", "x"), "--format ply, spz or rrd"),
    ],
)
def test_what_cannot_be_exported_gets_a_reason_and_no_file(export, tmp_path, monkeypatch, words, said):
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.chdir(tmp_path)
    status, told = export(*words)
    assert status and said in told and "Traceback" not in told and not list(tmp_path.iterdir())


def test_instances_as_a_point_cloud(export, tmp_path):
    status, said = export("--format", "instances", "--output", tmp_path / "x.ply")
    assert status == 0, said
    cloud = trimesh.load(tmp_path / "x.ply")
    owner = cloud.metadata["_ply_raw"]["vertex"]["data"]["instance_whole"].ravel()
    assert len(owner) == 700 and owner.max() > 0
    for one in np.unique(owner):
        assert len(np.unique(cloud.colors[owner == one], axis=0)) == 1, "an instance has one color"


def test_nerfstudio_cameras(page_scene, export, tmp_path):
    status, said = export("--format", "nerfstudio", "--output", tmp_path / "x")
    assert status == 0, said
    found = read_transforms(tmp_path / "x/transforms.json", CAMERA.width, CAMERA.height)
    np.testing.assert_allclose(found.camera_to_world, poses(page_scene), atol=1e-12)
    assert found.names == [f"images/{frame:06d}.png" for frame in POSED]
    points = open_artifact(page_scene / "poses.zarr", POSES)
    np.testing.assert_allclose(found.points, points.read("points/xyz"), atol=1e-5)
    rgb = open_artifact(page_scene / "frames.zarr", FRAMES).row("rgb", 4)
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "x/images/000004.png")), rgb)
    document = json.loads((tmp_path / "x/transforms.json").read_text())
    assert document["camera_model"] == "PINHOLE" and isinstance(document["w"], int)
    masks = [frame["mask_path"] for frame in document["frames"] if "mask_path" in frame]
    # A mask for every frame or for none, as large as its image.
    assert len(masks) in (0, len(POSED))
    assert all(Image.open(tmp_path / "x" / name).size == (CAMERA.width, CAMERA.height) for name in masks)


def test_colmap_cameras(page_scene, export, tmp_path):
    status, said = export("--format", "colmap", "--output", tmp_path / "x")
    assert status == 0, said
    model = pycolmap.Reconstruction(tmp_path / "x/sparse/0")
    assert {path.suffix for path in (tmp_path / "x/sparse/0").iterdir()} == {".txt", ".bin"}
    images = sorted(model.images.values(), key=lambda image: image.name)
    assert [image.name for image in images] == [f"{frame:06d}.png" for frame in POSED]
    for image, pose in zip(images, poses(page_scene), strict=True):
        np.testing.assert_allclose(image.cam_from_world().inverse().matrix(), pose[:3], atol=1e-9)
    np.testing.assert_allclose(model.cameras[1].calibration_matrix(), CAMERA.matrix)
    assert all((tmp_path / "x/images" / image.name).is_file() for image in images)


def test_what_readers_of_gaussians_check(export, tmp_path):
    """SuperSplat and splat-transform: short header lines of known types, whole bands of SH, all values finite."""
    status, said = export("--format", "ply", "--output", tmp_path / "x.ply")
    assert status == 0, said
    content = (tmp_path / "x.ply").read_bytes()
    head, mark, body = content.partition(b"\nend_header\n")
    assert content.startswith(b"ply\n") and mark and len(head) < 128 * 1024
    lines = [line.split(" ") for line in head.decode("ascii").splitlines()]
    assert {line[0] for line in lines} == {"ply", "format", "comment", "element", "property"}
    properties = [line[1:] for line in lines if line[0] == "property"]
    assert {kind for kind, _ in properties} == {"float"} and all(len(line) == 2 for line in properties)
    names = [name for _, name in properties]
    rest = [name for name in names if name.startswith("f_rest_")]
    assert rest == [f"f_rest_{one}" for one in range(len(rest))] and len(rest) in (0, 9, 24, 45)
    needed = {*"xyz", "opacity", "f_dc_0", "f_dc_1", "f_dc_2", "scale_0", "scale_1", "scale_2"}
    assert needed | {f"rot_{one}" for one in range(4)} <= {*names}
    values = np.frombuffer(body, "<f4").reshape(-1, len(names))
    assert lines[3] == ["element", "vertex", str(len(values))] and np.isfinite(values).all()


@pytest.mark.parametrize("format", ["ply", "spz", "instances", "nerfstudio", "colmap", "html"])
def test_without_artifacts_one_line_says_what_is_missing(tmp_path, monkeypatch, capfd, format):
    status, _, said = run_command(monkeypatch, capfd, "export", tmp_path, "--format", format)
    assert status == 2 and "lacks" in said and "Traceback" not in said
    assert not list(tmp_path.iterdir())
