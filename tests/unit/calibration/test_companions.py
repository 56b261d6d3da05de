"""The files of known poses: the reader needs no other, and of two formats it reads one."""

import numpy as np

from egosplat.calibration.files import known_pose_files
from egosplat.calibration.known_poses import read_known_poses
from tests.support.recordings import copy_files

SIZE = (64, 48)


def names(recording, wanted):
    return [path.relative_to(recording).as_posix() for path in known_pose_files(recording, wanted)]


def check_copy(pictures, kind, target):
    """Compare what is read of a recording with what is read of a copy that has only the listed files."""
    target.mkdir()
    copied = read_known_poses(copy_files(known_pose_files(pictures, kind), pictures, target), kind, *SIZE)
    found = read_known_poses(pictures, kind, *SIZE)
    assert (found.names, found.lenses) == (copied.names, copied.lenses)
    for name in ("camera_to_world", "points", "point_rgb", "point_error_px"):
        np.testing.assert_array_equal(getattr(found, name), getattr(copied, name))


def test_of_a_colmap_model_three_files_of_one_format_are_read(pictures, model, colmap_folder, tmp_path):
    binary = ["colmap/cameras.bin", "colmap/images.bin", "colmap/points3D.bin"]
    model.write_text(colmap_folder)
    assert names(pictures, "auto") == binary
    check_copy(pictures, "colmap", tmp_path / "binary")
    (colmap_folder / "images.bin").unlink()
    assert names(pictures, "colmap") == [name.replace(".bin", ".txt") for name in binary]
    check_copy(pictures, "colmap", tmp_path / "text")
    assert names(pictures, "none") == names(pictures, "transforms") == []


def test_a_transforms_file_names_the_file_of_its_points(pictures, transforms, tmp_path):
    transforms()
    assert names(pictures, "auto") == ["transforms.json"]
    (pictures / "cloud").mkdir()
    header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (pictures / "cloud/points.ply").write_text(f"{header}1 2 3\n")
    transforms(ply_file_path="cloud/points.ply")
    assert names(pictures, "auto") == ["transforms.json", "cloud/points.ply"]
    check_copy(pictures, "transforms", tmp_path / "copy")
