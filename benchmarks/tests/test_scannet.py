"""ScanNet by OpenGaussian's evaluation: preparing a scan, and scoring the vertices of its mesh."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import egosplat
from benchmarks.public.scannet import CLASSES, SETS, main, prepare, read_labels, score, score_scene
from egosplat.calibration.transforms_json import read_transforms
from egosplat.errors import UserError
from egosplat.export.gaussians import write_ply
from tests.support.page_scene import put_page_scene

WIDTH, HEIGHT = 64, 48

# A split with a picture that is not there.
UNKNOWN = '{"frames": [{"file_path": "color/77"}]}'


def pose(x: float) -> np.ndarray:
    """A camera at x that looks along z, turned about it; OpenCV's axes."""
    return np.array([[0.0, -1, 0, x], [1, 0, 0, 0.5], [0, 0, 1, -2], [0, 0, 0, 1]])


def export_scan(scan: Path, pictures: int = 5, lost: int = 3) -> Path:
    """A scan as ScanNet's reader exports it; the pose of one picture was lost."""
    for name in ("color", "pose", "intrinsic"):
        (scan / name).mkdir(parents=True)
    for number in range(pictures):
        Image.new("RGB", (WIDTH, HEIGHT), (number, 0, 0)).save(scan / "color" / f"{number}.jpg")
        matrix = np.full((4, 4), -np.inf) if number == lost else pose(0.1 * number)
        np.savetxt(scan / "pose" / f"{number}.txt", matrix)
    np.savetxt(
        scan / "intrinsic/intrinsic_color.txt", [[50.0, 0, 31, 0], [0, 51, 25, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )
    return scan


def write_labels(path: Path, points: np.ndarray, labels: np.ndarray) -> Path:
    columns = {axis: points[:, place] for place, axis in enumerate("xyz")}
    write_ply(path, columns | {"label": labels.astype(np.uint8)}, "synthetic")
    return path


def test_the_sets_are_those_of_the_benchmark():
    assert {count: len(names) for count, names in SETS.items()} == {19: 19, 15: 15, 10: 10}
    assert [CLASSES[name] for name in SETS[15]] == [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 33, 34]
    assert [CLASSES[name] for name in SETS[10]] == [1, 2, 4, 5, 6, 7, 8, 9, 10, 33]


def test_means_are_over_the_classes_of_the_scene():
    truth = np.array([1, 1, 1, 1, 5, 5, 0, 0])
    found = np.array([1, 1, 5, 7, 5, 5, 5, 1])  # class 7 is not there, and what has no label does not count
    assert score(truth, found).mean_iou == pytest.approx((2 / 4 + 2 / 3) / 2)
    assert score(truth, found).mean_accuracy == pytest.approx((2 / 4 + 2 / 2) / 2)


def test_an_exported_scan_gets_its_poses(tmp_path):
    scan = export_scan(tmp_path / "scan")
    write_labels(scan / "scan_vh_clean_2.ply", np.eye(3), np.arange(3))
    found = read_transforms(prepare(scan, every=1), WIDTH, HEIGHT)
    assert found.names == [f"color/{number}.jpg" for number in (0, 1, 2, 4)]
    assert np.allclose(found.camera_to_world[3], pose(0.4)) and len(found.points) == 3
    [lens] = found.lenses
    assert lens.params[:4] == (50, 51, 31, 25)


def test_every_n_th_picture_in_the_order_of_numbers(tmp_path):
    scan = export_scan(tmp_path / "scan", pictures=11, lost=-1)
    document = json.loads(prepare(scan, every=5).read_text())
    assert [one["file_path"] for one in document["frames"]] == ["color/0.jpg", "color/5.jpg", "color/10.jpg"]


def test_both_splits_of_opengaussian_are_taken(tmp_path):
    scan = export_scan(tmp_path / "scan")
    for name, numbers in (("train", (0, 1)), ("test", (2,))):
        frames = [{"file_path": f"color/{one}", "transform_matrix": np.eye(4).tolist()} for one in numbers]
        (scan / f"transforms_{name}.json").write_text(json.dumps({"camera_angle_x": 1.0, "frames": frames}))
    document = json.loads(prepare(scan, every=20).read_text())
    assert [one["file_path"] for one in document["frames"]] == [f"color/{one}.jpg" for one in range(3)]


@pytest.mark.parametrize(
    "spoil, told",
    [
        (lambda scan: (scan / "intrinsic/intrinsic_color.txt").unlink(), "intrinsic_color.txt"),
        (lambda scan: (scan / "pose/2.txt").unlink(), r"pose/2\.txt"),
        (lambda scan: (scan / "pose/2.txt").write_text("1 2 3"), r"pose/2\.txt"),
        (lambda scan: (scan / "transforms_test.json").write_text('{"frames": [{}]}'), "file_path"),
        (lambda scan: Image.new("RGB", (300, 200)).save(scan / "color/0.jpg"), "300 x 200"),
        (lambda scan: (scan / "transforms.json").write_text("{}"), "transforms.json"),
        (lambda scan: (scan / "transforms_train.json").write_text(UNKNOWN), "color/77"),
    ],
)
def test_a_scan_that_cannot_be_prepared(tmp_path, spoil, told):
    scan = export_scan(tmp_path / "scan")
    spoil(scan)
    with pytest.raises(UserError, match=told):
        prepare(scan, every=1)


def test_labels_are_needed(tmp_path):
    write_ply(tmp_path / "mesh.ply", {axis: np.zeros(3) for axis in "xyz"}, "synthetic")
    with pytest.raises(UserError, match=r"mesh\.ply.*label"):
        read_labels(tmp_path / "mesh.ply")


@pytest.fixture(scope="module")
def scene_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("work") / "results/adt/scene1"
    folder.mkdir(parents=True)
    put_page_scene(folder)
    return folder


def test_vertices_take_the_class_of_the_nearest_gaussian(scene_folder, tmp_path):
    scene = egosplat.open_scene(scene_folder)
    [couch] = scene.ask("sofa")[0].candidates[:1]
    points = scene.gaussians.means.numpy()[couch.members].astype(float) + 1e-6
    for name, right in (("sofa", True), ("toilet", False)):
        labels = write_labels(tmp_path / f"{name}.ply", points, np.full(len(points), CLASSES[name]))
        found = score_scene(scene, labels)
        assert {*found} == {*SETS}
        assert (found[10].mean_accuracy > 0.5) == right, (name, found)


def test_the_command_prints_a_row_beside_the_papers(scene_folder, tmp_path):
    points = np.zeros((4, 3))
    labels = write_labels(tmp_path / "labels.ply", points, np.array([5, 5, 5, 0]))
    done = CliRunner().invoke(main, [str(scene_folder), str(labels)])
    assert done.exit_code == 0, done.output
    assert "this scene" in done.output and "24.7 / 41.5" in done.output
    labels = write_labels(tmp_path / "none.ply", points, np.zeros(4))
    assert "no vertex" in CliRunner().invoke(main, [str(scene_folder), str(labels)]).output
