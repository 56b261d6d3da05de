"""``egosplat export``: a scene in formats of other programs, read back by these or by libraries; ``egosplat movie``."""

import json
import shutil
import sys
from functools import partial

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
from egosplat.export.movie import way
from tests.support.page_scene import CAMERA
from tests.support.scenes import put

POSED = [0, 1, 2, 4]
"""Frames of the scene that have a pose."""


@pytest.fixture
def export(page_scene, run_command):
    return partial(run_command, "export", page_scene)


def poses(scene) -> np.ndarray:
    return open_artifact(scene / "poses.zarr", POSES).read("camera_to_world")[POSED]


def test_without_words_all_gaussians_are_written_into_the_folder(page_scene, export):
    status, _, said = export()
    assert status == 0 and f"{page_scene / 'scene.ply'}: " in said
    (page_scene / "scene.ply").unlink()


def test_the_answer_to_a_query(export, tmp_path):
    for word, side in (("couch", -1), ("cup", 1)):
        status, _, said = export("--query", word, "--no-codes", "--output", tmp_path / f"{word}.ply")
        assert status == 0, said
        means = plyread(tmp_path / f"{word}.ply").means
        assert 50 < len(means) < 500 and np.median(means[:, 0]) * side > 0.3
    status, _, said = export("--query", "cup", "--format", "spz", "--output", tmp_path / "cup.spz")
    assert status == 0, said
    assert len(read_spz(tmp_path / "cup.spz").means) == len(means)


def rows_of(path) -> dict[str, list[dict]]:
    """The rows of each entity, as Rerun reads them."""
    rows: dict[str, list[dict]] = {}
    for chunk in pytest.importorskip("rerun.experimental").RrdReader(path).stream().to_chunks():
        rows.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pylist())
    return rows


def test_rerun_reads_its_recording(page_scene, export, tmp_path):
    status, _, said = export("--query", "couch, elephant", "--output", tmp_path / "scene.rrd")
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
    assert 0 < len(points["Points3D:positions"]) <= 700 and "found, probability" in couch["Boxes3D:labels"][0]
    assert couch["Boxes3D:centers"][0][0] < -0.3 and not elephant["Boxes3D:centers"]


@pytest.mark.parametrize(
    "words, said",
    [
        (("--output", "x.rrd"), 'pip install "egosplat[rerun]"'),
        (("--output", "x"), "has no suffix of a format; give the format: ply, spz"),
        (("--query", "elephant", "--output", "x.ply"), "elephant"),
        (("--query", "couch and cup", "--output", "x.ply"), "asks for 2 things; ask for one"),
        (("--query", "cup", "--format", "colmap", "--output", "x"), "--format ply, spz or rrd"),
    ],
)
def test_what_cannot_be_exported_gets_a_reason_and_no_file(export, tmp_path, monkeypatch, words, said):
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.chdir(tmp_path)
    status, _, told = export(*words)
    assert status and said in told and "Traceback" not in told and not list(tmp_path.iterdir())


def test_instances_as_a_point_cloud(export, tmp_path):
    status, _, said = export("--format", "instances", "--output", tmp_path / "x.ply")
    assert status == 0, said
    cloud = trimesh.load(tmp_path / "x.ply")
    owner = cloud.metadata["_ply_raw"]["vertex"]["data"]["instance_whole"].ravel()
    assert len(owner) == 700 and owner.max() > 0
    for one in np.unique(owner):
        assert len(np.unique(cloud.colors[owner == one], axis=0)) == 1, "an instance has one color"


def test_nerfstudio_cameras(page_scene, export, tmp_path):
    status, _, said = export("--format", "nerfstudio", "--output", tmp_path / "x")
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


def test_colmap_cameras(page_scene, run_command, tmp_path):
    """Masks of other frames, which another run left, are left out."""
    scene = shutil.copytree(page_scene, tmp_path / "scene1")
    put(scene, "masks", inputs={"frames.zarr": "0" * 64}, size=1)
    status, _, said = run_command("export", scene, "--format", "colmap", "--output", tmp_path / "x")
    assert status == 0, said
    model = pycolmap.Reconstruction(tmp_path / "x/sparse/0")
    assert {path.suffix for path in (tmp_path / "x/sparse/0").iterdir()} == {".txt", ".bin"}
    images = sorted(model.images.values(), key=lambda image: image.name)
    assert [image.name for image in images] == [f"{frame:06d}.png" for frame in POSED]
    for image, pose in zip(images, poses(page_scene), strict=True):
        np.testing.assert_allclose(image.cam_from_world().inverse().matrix(), pose[:3], atol=1e-9)
    np.testing.assert_allclose(model.cameras[1].calibration_matrix(), CAMERA.matrix)
    assert all((tmp_path / "x/images" / image.name).is_file() for image in images)


@pytest.mark.parametrize("codes", ["--codes", "--no-codes"])
def test_what_readers_of_gaussians_check(export, tmp_path, codes):
    """SuperSplat and splat-transform: short header lines of known types, whole bands of SH, all values finite."""
    status, _, said = export("--output", tmp_path / "x.ply", codes)
    assert status == 0 and "700 Gaussians" in said
    assert len(plyread(tmp_path / "x.ply").means) == 700
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
    needed = {*"xyz", "opacity", *(f"rot_{one}" for one in range(4))}
    assert needed | {f"{name}_{one}" for name in ("f_dc", "scale") for one in range(3)} <= {*names}
    assert ("code_whole_0" in names) == (codes == "--codes")
    values = np.frombuffer(body, "<f4").reshape(-1, len(names))
    assert lines[3] == ["element", "vertex", str(len(values))] and np.isfinite(values).all()


@pytest.mark.parametrize("format", ["ply", "spz", "instances", "nerfstudio", "colmap", "html", None])
def test_without_artifacts_one_line_says_what_is_missing(tmp_path, run_command, format):
    words = ("page", tmp_path) if format is None else ("export", tmp_path, "--format", format)
    status, _, said = run_command(*words)
    assert status == 2 and "lacks" in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.fixture
def movie(page_scene, tmp_path, run_command):
    return partial(run_command, "movie", page_scene, "--output", tmp_path / "x.webp", "--side", 64)


def test_the_picture_moves_and_the_answer_lights_up(movie, tmp_path):
    status, _, said = movie("wall", "couch", "elephant")
    assert status == 0, said
    assert "elephant" in said and "left out" in said
    with Image.open(tmp_path / "x.webp") as moving:
        assert moving.size[0] == 64 < moving.size[1] and moving.n_frames > 8
        moving.seek(moving.n_frames - 1)
        last = np.asarray(moving.convert("RGB"))[:64].astype(int)
    redness = last[..., 0] - last[..., 2]
    assert redness[:, 16:36].mean() > redness[:, 44:].mean() + 20, "the couch is left of the wall"


def test_without_an_answer_nothing_is_written(movie, tmp_path):
    status, _, said = movie("elephant")
    assert status == 2 and "no query has an answer" in said and not (tmp_path / "x.webp").exists()


def test_the_way_follows_the_recording_and_leaves_out_frames_without_a_pose():
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[3] = np.nan
    assert way(poses, 1, 5) == [2, 4, 5] and way(poses, 5, 1) == [4, 2, 1] and way(poses, 2, 2) == []
    long = way(np.tile(np.eye(4), (100, 1, 1)), 0, 99)
    assert len(long) == 16 and long[-1] == 99
