"""Known poses are read as they are, and a damaged or unfit file is named with what is wrong."""

import re
import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import trimesh

from egosplat.calibration.files import known_pose_files
from egosplat.calibration.known_poses import check_numbers, find_known_poses, match_pictures, read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.calibration.ply import read_points
from egosplat.errors import UserError
from tests.support import ROOT
from tests.support.scenes import sideways
from tests.unit.calibration.conftest import HEIGHT, NAMES, WIDTH

SIZE = (WIDTH, HEIGHT)
FILES = ("cameras", "images", "points3D")


def files_of(recording, wanted):
    return [path.relative_to(recording).as_posix() for path in known_pose_files(recording, wanted)]


def check_poses(contents, model):
    """Each picture's pose is the model's, to rounding."""
    assert sorted(Path(name).name for name in contents.names) == NAMES
    true = {image.name: image.cam_from_world().inverse().matrix() for image in model.images.values()}
    for name, pose in zip(contents.names, contents.camera_to_world, strict=True):
        np.testing.assert_allclose(pose, [*true[Path(name).name], [0, 0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("write", [pycolmap.Reconstruction.write_binary, pycolmap.Reconstruction.write_text])
def test_a_colmap_model_is_read_as_it_is(pictures, model, write):
    (pictures / "colmap").mkdir()
    write(model, pictures / "colmap")
    contents = read_known_poses(pictures, "colmap", *SIZE)
    assert contents.lenses == [Lens("RADIAL", WIDTH, HEIGHT, (60.0, 31.0, 25.0, 0.05, -0.01))]
    check_poses(contents, model)
    assert contents.points.shape == (30, 3) and contents.point_views.min() >= 2


def test_a_transforms_file_is_turned_from_opengl(pictures, model, transforms):
    transforms(applied_transform=[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], applied_scale=0.5)
    contents = read_known_poses(pictures, "transforms", *SIZE)
    assert contents.lenses == [Lens("OPENCV", WIDTH, HEIGHT, (60.0, 60.0, 31.0, 25.0, 0.05, -0.01, 0.0, 0.0))]
    check_poses(contents, model)
    assert contents.notes["applied_scale"] == 0.5 and len(contents.notes["applied_transform"]) == 3


@pytest.mark.parametrize("binary", [True, False])
def test_points_of_a_transforms_file(pictures, transforms, binary):
    xyz, rgb = np.array([[1, 2, 3], [-1, 0.5, 0]]), np.array([[9, 8, 7], [255, 0, 1]], np.uint8)
    encoding = "binary" if binary else "ascii"
    trimesh.PointCloud(xyz, rgb).export(pictures / "cloud.ply", encoding=encoding)
    transforms(ply_file_path="cloud.ply")
    assert files_of(pictures, "auto") == ["transforms.json", "cloud.ply"]
    contents = read_known_poses(pictures, "transforms", *SIZE)
    np.testing.assert_array_equal(contents.points, xyz)
    np.testing.assert_array_equal(contents.point_rgb, rgb)
    (pictures / "cloud.ply").write_bytes((pictures / "cloud.ply").read_bytes()[:-6])
    with pytest.raises(UserError, match="cloud.ply: not a readable PLY"):
        read_known_poses(pictures, "transforms", *SIZE)


POINTS = "ply\nformat ascii 1.0\ncomment K\u00fcche, end_header\nelement vertex 1\n{}end_header\n1 2 3 {}\n"
RGB = ("red", "green", "blue")


@pytest.mark.parametrize("names", [RGB, [f"diffuse_{name}" for name in RGB], "rgb", "RGB"])
@pytest.mark.parametrize("kind", ["uchar", "float", "double", "ushort", "int"])
def test_points_of_other_programs_have_colors_or_are_named(tmp_path, capsys, kind, names):
    row = {"float": "1 0.04 0", "ushort": "65535 2570 0", "int": "65535 2570 0"}.get(kind, "255 10 0")
    types = dict.fromkeys("xyz", "float") | dict.fromkeys(names, kind)
    head = "".join(f"property {kind} {name}\n" for name, kind in types.items())
    text, path = POINTS.format(head, row), tmp_path / "p.ply"
    path.write_text(text, encoding="utf-8")
    assert read_points(path)[1].tolist() == [[255, 10, 0]] and not capsys.readouterr().err
    gray = text.replace(row, "3e38 10 0") if kind == "double" else text.replace(f" {names[2]}\n", " gray\n")
    path.write_text(gray, encoding="utf-8")
    assert read_points(path)[1].tolist() == [[128] * 3] and "and are gray" in capsys.readouterr().err
    beyond = [text.replace("255", "256"), text.replace("255", "-1")] if kind == "uchar" else []
    for wrong in (*beyond, text.replace("vertex 1", "vertex -1"), text.replace(row, "x 10 0")):
        path.write_text(wrong, encoding="utf-8")
        with pytest.raises(UserError, match="p.ply: not a readable"):
            read_points(path)


def test_the_format_is_found_or_named(pictures, colmap_folder, transforms):
    assert find_known_poses(pictures, "auto") == "colmap"
    with pytest.raises(UserError, match=r"transforms.json: not found, but frames.known_poses"):
        find_known_poses(pictures, "transforms")
    transforms()
    with pytest.raises(UserError, match=r"colmap and .*/transforms.json: choose .*frames.known_poses"):
        find_known_poses(pictures, "auto")
    assert find_known_poses(pictures, "transforms") == "transforms"
    assert find_known_poses(pictures, "none") is None
    shutil.rmtree(colmap_folder)
    assert find_known_poses(pictures, "auto") == "transforms"
    assert files_of(pictures, "auto") == ["transforms.json"]
    (pictures / "transforms.json").unlink()
    assert find_known_poses(pictures, "auto") is None


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("keep", [0, 4, 20, -10, b"\2" + bytes(7) + b"\xff" * 60])
def test_a_cut_binary_file_is_named_and_one_of_too_large_numbers(pictures, colmap_folder, name, keep):
    """COLMAP itself hangs, or reads values that are not there."""
    file = colmap_folder / f"{name}.bin"
    file.write_bytes(keep if isinstance(keep, bytes) else file.read_bytes()[:keep])
    with pytest.raises(UserError, match=f"{name}.bin: damaged or incomplete"):
        read_known_poses(pictures, "colmap", *SIZE)
    file.unlink()
    with pytest.raises(UserError, match=f"colmap: has no {name}.bin. .*frames.known_poses=none"):
        read_known_poses(pictures, "colmap", *SIZE)


POSE_OF_3 = r"(?<= )\S+ \S+ \S+ \S+ \S+ \S+ \S+(?= \d+ 3.png)"
NOT_RIGID = "3.png: the pose|not a readable COLMAP model"
BAD_MODELS = [
    *((name, ".*", "hello world\n", "not a readable") for name in FILES),
    *((name, ".*", "\xff\x00\xfe" * 50, "not a readable") for name in FILES),
    ("images", "3.png", "3 a.png", "images.txt: 3 a.png: no spaces in names"),
    ("images", "3.png\n.*?\n", "3.png\n", "images.txt: 3.png: the next line must have its points"),
    ("images", "3.png", "\xfc.png", "not a readable COLMAP model .'utf-8'"),
    ("images", POSE_OF_3, "1 0 0 0 1e999 2 3", NOT_RIGID),
    ("images", POSE_OF_3, "1 0 0 0 nan 2 3", NOT_RIGID),
    ("images", POSE_OF_3, "1 1 0 0 1 2 3", NOT_RIGID),
    ("images", POSE_OF_3, "0 0 0 0 1 2 3", NOT_RIGID),
]


@pytest.mark.parametrize("name, old, new, problem", BAD_MODELS)
def test_a_bad_text_model_is_named(pictures, model, name, old, new, problem):
    (folder := pictures / "colmap").mkdir()
    model.write_text(folder)
    path = folder / f"{name}.txt"
    path.write_text(re.sub(old, new, path.read_text(), count=1, flags=re.DOTALL), encoding="latin-1")
    with pytest.raises(UserError, match=f"colmap[:/] ?({problem})") as caught:
        read_known_poses(pictures, "colmap", *SIZE)
    assert "/tmp/egosplat-model" not in str(caught.value)


NAN, POSE, ANGLE = float("nan"), np.eye(4).tolist(), {"fl_x": None, "fl_y": None}


def frame(*rows: list[float], **changes: object) -> list[dict[str, object]]:
    return [{"file_path": "images/1.png", "transform_matrix": rows or POSE} | changes]


@pytest.mark.parametrize(
    "changes, problem",
    [
        *((text, "") for text in ("", "{", "[1]", "[" * 5000)),
        *(({"frames": frames}, "frames") for frames in ({}, [])),
        ({"frames": frame(file_path=None)}, r"frames\[0\], None: file_path"),
        ({"frames": frame([1, 0], [0, 1])}, "images/1.png: transform_matrix"),
        ({"frames": frame(*np.diag([2.0, 2, 2, 1]).tolist())}, "images/1.png: the pose is not a rotation"),
        ({"frames": frame(*np.diag([-1.0, 1, 1, 1]).tolist())}, "images/1.png: the pose is not a rotation"),
        ({"frames": frame(*[[NAN] * 4] * 4)}, "images/1.png: transform_matrix.0.0: .*finite"),
        ({"frames": frame(fl_x=70.0)}, "images/1.png: fl_x differs from that of the whole file"),
        ({"frames": frame(transform_matrix_end=POSE)}, "images/1.png: transform_matrix_end is not"),
        ({"frames": frame(mask_path=3)}, "images/1.png: mask_path"),
        *(({key: 0.1}, f"{key} is not supported") for key in ("latlong", "ftheta_p0", "k5", "omega")),
        ({"applied_transform": np.zeros((4, 4)).tolist()}, "applied_transform is not a rotation"),
        ({"k1": 0.1, "distortion_params": [0.2, 0, 0, 0, 0, 0]}, "distortion_params differs"),
        ({"camera_model": "FISHEYE624"}, "camera_model: .*OPENCV_FISHEYE"),
        ({"camera_model": "OPENCV_FISHEYE", "p1": 0.1}, "OPENCV_FISHEYE has k1 to k4"),
        ({"k1": 0.0, "distortion_params": [0.1, 0, 0, 0]}, "distortion_params: .*6 items"),
        ({"distortion_params": [NAN] * 6}, "distortion_params.0: .*finite"),
        (ANGLE, "has neither fl_x nor camera_angle_x"),
        *(({"fl_x": text}, f"fl_x: .*number, not the text '{text}'") for text in ("wide", "60")),
        ({"fl_x": 10**400}, "fl_x: .*number"),
        ({"k1": NAN}, "images/1.png: k1: .*finite"),
        ({"k4": 0.1}, "OPENCV has k1 to k3"),
        *(({"w": width}, "w: ") for width in (64.5, 1e300, True, "64")),
        ({"frames": frame([1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0])}, "1e.300 from the origin"),
        *((camera, "in pixels") for camera in ({"fl_x": -60.0}, {"fl_y": 600.0}, ANGLE | {"x_fov": 1e-9})),
        ({"k1": 1e6}, "magnifies"),
        (ANGLE | {"camera_angle_x": 60.0}, "camera_angle_x is 60, .*radians"),
        (ANGLE | {"x_fov": 200.0}, "x_fov is 200, .*degrees"),
        *(({"cx": cx}, r"\(cx, cy\) inside") for cx in (100.0, 0.5)),
        ({"applied_scale": 0}, "applied_scale"),
        ({"ply_file_path": "nowhere.ply"}, "no file .*nowhere.ply. Remove the key"),
        *(({"ply_file_path": path}, "ply_file_path") for path in (3, [])),
    ],
)
def test_a_bad_transforms_file_is_named(pictures, transforms, changes, problem):
    path = transforms(**(changes if isinstance(changes, dict) else {}))
    path.write_text(changes) if isinstance(changes, str) else None
    assert path in known_pose_files(pictures, "auto")
    with pytest.raises(UserError, match=f"transforms.json: .*{problem}") as caught:
        read_known_poses(pictures, "transforms", *SIZE)
    assert "\n" not in str(caught.value)


def test_a_pose_written_with_few_digits_is_made_rigid(pictures, transforms):
    pose = np.array([[0.8660, -0.5, 0, 0], [0.5, 0.8660, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    transforms(frames=frame(transform_matrix=pose.tolist()))
    (found,) = read_known_poses(pictures, "transforms", *SIZE).camera_to_world
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found, pose * [1, -1, -1, 1], atol=1e-4)


def test_the_script_of_the_page_converts_a_data_set(pictures, model, folder):
    shutil.copytree(pictures, "sequence/rgb")
    rows = {image.name: image.cam_from_world().inverse().matrix().ravel() for image in model.images.values()}
    np.savetxt("sequence/poses.txt", [[*rows[name], 0, 0, 0, 1] for name in NAMES])
    page = (ROOT / "docs/recordings.md").read_text(encoding="utf-8")
    exec(page.partition("```python\n")[2].partition("```")[0], {})  # noqa: S102
    check_poses(read_known_poses(Path("converted"), "transforms", 640, 480), model)


MATCHES = {
    "a path, no extension, a converted picture": (
        ["./images/a 1.png", "b", "sub\\c.jpeg", "gone.png", "d.0001"],
        ["a 1.png", "b.jpg", "c.png", "d.0001.png", "e.png"],
        [0, 1, 2, 4, -1],
    ),
    "a name twice": (["x/2.png", "x/1.png", "y/1.png"], ["x/1.png", "y/1.png", "x/2.png"], [1, 2, 0]),
    "a folder above": (["images/x/1.png", "/home/me/images/y/1.png"], ["x/1.png", "y/1.png"], [0, 1]),
    "a folder that the file leaves out": (["1.png", "2.png"], ["x/1.png", "y/2.png"], [0, 1]),
    "another folder": (["x/1.png", "y/2.png"], ["x/1.png", "x/2.png"], [0, -1]),
    "letters in parts": (["x/ku\u0308che.png", "a.png"], ["x/k\u00fcche.png", "y/a.png"], [0, 1]),
    "numbers of a video": (["00012.png", "3"], ["3", "12", "21"], [1, 0, -1]),
    "numbers of pictures are names": (["1.png", "000002.png"], ["1.png", "2.png"], [0, -1]),
}


@pytest.mark.parametrize("names, pictures, row", MATCHES.values(), ids=MATCHES)
def test_names_match_pictures(tmp_path, names, pictures, row):
    matched, unmatched = match_pictures(names, pictures, tmp_path)
    assert matched.tolist() == row
    assert unmatched == [name for index, name in enumerate(names) if index not in row]


def test_names_that_match_twice_or_never_are_named(tmp_path):
    with pytest.raises(UserError, match="left/1.png and right/1.png are both the picture 1.png"):
        match_pictures(["left/1.png", "right/1.png"], ["1.png"], tmp_path)
    with pytest.raises(UserError, match="1.png is both left/1.png and right/1.png"):
        match_pictures(["1.png"], ["left/1.png", "right/1.png"], tmp_path)
    with pytest.raises(UserError, match="none of its 2 names, such as 0.png, .* such as 1.png"):
        match_pictures(["0.png", "000001.png"], ["1.png"], tmp_path)


def test_numbers_beyond_a_video_are_named(tmp_path):
    check_numbers(["00011.png", "other.png"], 12, tmp_path)  # tools that take a video apart count from 1
    with pytest.raises(UserError, match="00012.png: the video has the frames 0 to 11"):
        check_numbers(["00001.png", "00012.png"], 12, tmp_path)


def entries(count, **changes):
    """Frames along a line, 0.3 apart."""
    poses = sideways(0.3 * np.arange(count))
    return [{"file_path": f"{i}.png", "transform_matrix": poses[i].tolist()} | changes for i in range(count)]


FEW, FOUR, FISH = (0.1, -0.02, 0.01, 0.02), (0.01, 0.02, 0.03, 0.04), "OPENCV_FISHEYE"


@pytest.mark.parametrize("per_frame", [False, True])
@pytest.mark.parametrize(
    "camera, kind, params",
    [
        ({"distortion_params": [0.1, -0.02, 0.0, 0, 0.01, 0.02]}, "OPENCV", FEW),
        ({"distortion_params": [0.1, -0.02, 0.3, 0, 0.01, 0.02]}, "FULL_OPENCV", (*FEW, 0.3, 0, 0, 0)),
        ({"camera_model": FISH, "distortion_params": [0.01, 0.02, 0.03, 0.04, 0, 0]}, FISH, FOUR),
        ({"x_fov": 90.0}, "OPENCV", (0.0,) * 4),
    ],
)
def test_distortion_of_all_frames_or_of_each(pictures, transforms, per_frame, camera, kind, params):
    """nerfstudio's list, whose order is k1 to k4, p1, p2; fields of view in degrees are instant-ngp's."""
    intrinsics = {"fl_x": 32.0, "cx": 32.0, "cy": 24.0} if "x_fov" not in camera else {}
    own, whole = (camera | intrinsics, {}) if per_frame else ({}, camera | intrinsics)
    nothing = dict.fromkeys(("camera_model", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"))
    transforms(**nothing | whole, frames=entries(2, **own))
    (lens,) = read_known_poses(pictures, "transforms", *SIZE).lenses
    assert (lens.model, lens.params) == (kind, pytest.approx((32.0, 32.0, 32.0, 24.0, *params)))


def test_keys_that_do_not_count_are_told(pictures, transforms):
    transforms(aabb_scale=16, orientation_override="none", frames=entries(2, colmap_im_id=1, sharpness=9.0))
    unread = read_known_poses(pictures, "transforms", *SIZE).unread
    assert unread == ["aabb_scale", "orientation_override", "colmap_im_id", "sharpness"]


@pytest.mark.parametrize("far", [[2], range(4)])
def test_positions_far_from_each_other_or_from_the_origin_are_named(pictures, transforms, far):
    frames = entries(4)
    for index in far:
        frames[index]["transform_matrix"][1][3] = 4e6
    transforms(frames=frames)
    with pytest.raises(UserError, match=r"transforms.json: \d.png: 4e\+06 from the origin"):
        read_known_poses(pictures, "transforms", *SIZE)
    for one in frames:
        one["transform_matrix"][1][3] = 0.0
        one["transform_matrix"][0][3] *= 1e6
    transforms(frames=frames)
    assert read_known_poses(pictures, "transforms", *SIZE).camera_to_world[3, 0, 3] == pytest.approx(9e5)


def test_of_a_colmap_model_three_files_of_one_format_are_read(pictures, model, colmap_folder):
    binary = ["colmap/cameras.bin", "colmap/images.bin", "colmap/points3D.bin"]
    model.write_text(colmap_folder)
    assert files_of(pictures, "auto") == binary
    (colmap_folder / "images.bin").unlink()
    assert files_of(pictures, "colmap") == [name.replace(".bin", ".txt") for name in binary]
    assert files_of(pictures, "none") == files_of(pictures, "transforms") == []
    (colmap_folder / "points3D.txt").unlink()
    with pytest.raises(UserError, match=r"has no images\.bin"):
        read_known_poses(pictures, "colmap", *SIZE)
