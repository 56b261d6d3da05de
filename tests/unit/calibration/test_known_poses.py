"""Known poses are read as they are, and a damaged or unfit file is named with what is wrong."""

import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from egosplat.calibration.files import known_pose_files
from egosplat.calibration.known_poses import check_numbers, find_known_poses, match_pictures, read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError

WIDTH, HEIGHT = 64, 48
SIZE = (WIDTH, HEIGHT)


def true_pose(model: pycolmap.Reconstruction, name: str) -> np.ndarray:
    (image,) = [one for one in model.images.values() if one.name == name]
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().inverse().matrix()
    return pose


@pytest.mark.parametrize("folder", ["colmap_folder", "text_folder"])
def test_a_colmap_model_is_read_as_it_is(pictures, model, folder, request):
    request.getfixturevalue(folder)
    contents = read_known_poses(pictures, "colmap", *SIZE)
    assert contents.lenses == [Lens("RADIAL", WIDTH, HEIGHT, (60.0, 31.0, 25.0, 0.05, -0.01))]
    assert sorted(contents.names) == [f"{number}.png" for number in range(1, 7)]
    for name, pose in zip(contents.names, contents.camera_to_world, strict=True):
        np.testing.assert_allclose(pose, true_pose(model, name), atol=1e-12)
    assert contents.points.shape == (30, 3) and contents.point_views.min() >= 2


def test_a_transforms_file_is_turned_from_opengl(pictures, model, transforms):
    transforms(applied_transform=[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], applied_scale=0.5)
    contents = read_known_poses(pictures, "transforms", *SIZE)
    assert contents.lenses == [Lens("OPENCV", WIDTH, HEIGHT, (60.0, 60.0, 31.0, 25.0, 0.05, -0.01, 0.0, 0.0))]
    for name, pose in zip(contents.names, contents.camera_to_world, strict=True):
        np.testing.assert_allclose(pose, true_pose(model, Path(name).name), atol=1e-12)
    assert contents.notes["applied_scale"] == 0.5 and len(contents.notes["applied_transform"]) == 3


@pytest.mark.parametrize("binary", [True, False])
def test_points_of_a_transforms_file(pictures, transforms, binary):
    table = np.array(
        [(1.0, 2.0, 3.0, 9, 8, 7), (-1.0, 0.5, 0.0, 255, 0, 1)],
        dtype=[*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name in ("red", "green", "blue"))],
    )
    kind = "binary_little_endian" if binary else "ascii"
    lines = ["ply", f"format {kind} 1.0", "element vertex 2", *(f"property float {axis}" for axis in "xyz")]
    lines += [*(f"property uchar {name}" for name in ("red", "green", "blue")), "end_header", ""]
    rows = "\n".join(" ".join(map(str, row)) for row in table.tolist())
    body = table.tobytes() if binary else rows.encode()
    (pictures / "cloud.ply").write_bytes("\n".join(lines).encode() + body)
    transforms(ply_file_path="cloud.ply")
    contents = read_known_poses(pictures, "transforms", *SIZE)
    np.testing.assert_array_equal(contents.points, [[1, 2, 3], [-1, 0.5, 0]])
    np.testing.assert_array_equal(contents.point_rgb, [[9, 8, 7], [255, 0, 1]])
    (pictures / "cloud.ply").write_bytes((pictures / "cloud.ply").read_bytes()[:-6])
    with pytest.raises(UserError, match="cloud.ply: not a readable PLY"):
        read_known_poses(pictures, "transforms", *SIZE)


def test_the_format_is_found_or_named(pictures, colmap_folder, transforms):
    assert find_known_poses(pictures, "auto") == "colmap"
    with pytest.raises(UserError, match=r"transforms.json: not found, but frames.known_poses"):
        find_known_poses(pictures, "transforms")
    transforms()
    with pytest.raises(UserError, match=r"has colmap and transforms.json. .*frames.known_poses"):
        find_known_poses(pictures, "auto")
    assert find_known_poses(pictures, "transforms") == "transforms"
    assert find_known_poses(pictures, "none") is None
    shutil.rmtree(colmap_folder)
    assert find_known_poses(pictures, "auto") == "transforms"
    (pictures / "transforms.json").unlink()
    assert find_known_poses(pictures, "auto") is None


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("keep", [0, 4, 20, -10])
def test_a_cut_binary_file_is_named(pictures, colmap_folder, name, keep):
    """COLMAP itself hangs, or reads values that are not there."""
    file = colmap_folder / f"{name}.bin"
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(UserError, match=f"{name}.bin: damaged or incomplete"):
        read_known_poses(pictures, "colmap", *SIZE)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("content", [b"hello world\n", b"\xff\x00\xfe" * 50])
def test_a_text_file_of_something_else_is_named(pictures, text_folder, name, content):
    (text_folder / f"{name}.txt").write_bytes(content)
    with pytest.raises(UserError, match="colmap: not a readable COLMAP model") as caught:
        read_known_poses(pictures, "colmap", *SIZE)
    assert "/tmp/egosplat-model" not in str(caught.value)


def test_a_folder_without_a_model_is_named(pictures, colmap_folder):
    (colmap_folder / "images.bin").unlink()
    with pytest.raises(UserError, match="colmap: has no images.bin. A COLMAP model has"):
        read_known_poses(pictures, "colmap", *SIZE)


def test_a_model_with_two_cameras_has_a_lens_for_each(pictures, model, text_folder):
    other = pycolmap.Camera(model="RADIAL", width=WIDTH, height=HEIGHT, params=[61.0, 31.0, 25.0, 0.0, 0.0])
    other.camera_id = 2
    model.add_camera_with_trivial_rig(other)
    model.write_text(text_folder)
    for name in ("rigs.txt", "frames.txt"):
        (text_folder / name).unlink()
    text = (text_folder / "images.txt").read_text().replace(" 1 3.png", " 2 3.png")
    (text_folder / "images.txt").write_text(text)
    contents = read_known_poses(pictures, "colmap", *SIZE)
    focal = {
        name: contents.lenses[index].params[0]
        for name, index in zip(contents.names, contents.lens_of, strict=True)
    }
    assert focal == {name: 61.0 if name == "3.png" else 60.0 for name in contents.names}


def test_an_unsupported_model_of_colmap_is_named(pictures, text_folder):
    (text_folder / "cameras.txt").write_text(f"1 FOV {WIDTH} {HEIGHT} 60 60 31 25 0.9\n")
    with pytest.raises(UserError, match="colmap: 1.png: camera model FOV is not supported.*OPENCV_FISHEYE"):
        read_known_poses(pictures, "colmap", *SIZE)


def test_a_name_with_a_space_is_named(pictures, text_folder):
    path = text_folder / "images.txt"
    path.write_text(path.read_text().replace("3.png", "3 a.png"))
    with pytest.raises(UserError, match="images.txt: 3 a.png: no spaces in names"):
        read_known_poses(pictures, "colmap", *SIZE)


@pytest.mark.parametrize(
    "numbers", ["1 0 0 0 1e999 2 3", "1 0 0 0 nan 2 3", "1 1 0 0 1 2 3", "0 0 0 0 1 2 3"]
)
def test_a_pose_that_is_no_rotation_is_named(pictures, text_folder, numbers):
    lines = (text_folder / "images.txt").read_text().splitlines()
    at = next(index for index, line in enumerate(lines) if line.endswith("3.png"))
    words = lines[at].split()
    lines[at] = " ".join([words[0], numbers, *words[8:]])
    (text_folder / "images.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match="colmap: (3.png: the pose|not a readable COLMAP model)"):
        read_known_poses(pictures, "colmap", *SIZE)


def frame(**changes: object) -> list[dict[str, object]]:
    return [{"file_path": "images/1.png", "transform_matrix": np.eye(4).tolist()} | changes]


def moved(*rows: list[float]) -> list[dict[str, object]]:
    return frame(transform_matrix=list(rows))


NAN, POSE = float("nan"), np.eye(4).tolist()


@pytest.mark.parametrize(
    "changes, problem",
    [
        ({"frames": {}}, "frames"),
        ({"frames": []}, "frames"),
        ({"frames": frame(file_path=None)}, r"frames\[0\], None: file_path"),
        ({"frames": moved([1, 0], [0, 1])}, "images/1.png: transform_matrix"),
        ({"frames": moved(*np.diag([2.0, 2, 2, 1]).tolist())}, "images/1.png: the pose is not a rotation"),
        ({"frames": moved(*np.diag([-1.0, 1, 1, 1]).tolist())}, "images/1.png: the pose is not a rotation"),
        ({"frames": moved(*[[NAN] * 4] * 4)}, "images/1.png: transform_matrix.0.0: .*finite"),
        ({"frames": frame(fl_x=70.0)}, "images/1.png: fl_x differs from that of the whole file"),
        ({"frames": frame(transform_matrix_end=POSE)}, "images/1.png: transform_matrix_end is not"),
        ({"frames": frame(mask_path=3)}, "images/1.png: mask_path"),
        ({"latlong": True}, "latlong is not supported"),
        ({"ftheta_p0": 1.0}, "ftheta_p0 is not supported"),
        ({"k5": 0.1}, "k5 is not supported"),
        ({"applied_transform": np.zeros((4, 4)).tolist()}, "applied_transform is not a rotation"),
        ({"k1": 0.1, "distortion_params": [0.2, 0, 0, 0, 0, 0]}, "distortion_params differs"),
        ({"camera_model": "FISHEYE624"}, "camera_model: .*OPENCV_FISHEYE"),
        ({"camera_model": "OPENCV_FISHEYE", "p1": 0.1}, "OPENCV_FISHEYE has k1 to k4"),
        ({"k1": 0.0, "distortion_params": [0.1, 0, 0, 0]}, "distortion_params: .*6 items"),
        ({"distortion_params": [NAN] * 6}, "distortion_params.0: .*finite"),
        ({"fisheye_crop_radius": 9.0}, "fisheye_crop_radius is not supported"),
        ({"fl_x": None, "fl_y": None}, "has neither fl_x nor camera_angle_x"),
        ({"fl_x": "wide"}, "fl_x: .*number"),
        ({"fl_x": "60"}, "fl_x: .*number"),
        ({"fl_x": 10**400}, "fl_x: .*number"),
        ({"k1": NAN}, "images/1.png: k1: .*finite"),
        ({"k4": 0.1}, "OPENCV has k1 to k3"),
        ({"w": 64.5}, "w: "),
        ({"h": 1e300}, "h: "),
        ({"frames": moved([1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0])}, "1e.300 from the origin"),
        ({"fl_x": -60.0}, "fx, fy must be positive"),
        ({"cx": 100.0}, r"\(cx, cy\) inside"),
        ({"applied_scale": 0}, "applied_scale"),
        ({"ply_file_path": "nowhere.ply"}, "nowhere.ply: not a readable PLY"),
        ({"ply_file_path": 3}, "ply_file_path"),
        ({"ply_file_path": []}, "ply_file_path"),
    ],
)
def test_a_bad_transforms_file_is_named(pictures, transforms, changes, problem):
    transforms(**changes)
    assert pictures / "transforms.json" in known_pose_files(pictures, "auto")
    with pytest.raises(UserError, match=f"transforms.json: .*{problem}|nowhere.ply: not a") as caught:
        read_known_poses(pictures, "transforms", *SIZE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "[" * 5000])
def test_a_transforms_file_that_is_no_object_is_named(pictures, text):
    (pictures / "transforms.json").write_text(text)
    with pytest.raises(UserError, match="transforms.json: "):
        read_known_poses(pictures, "transforms", *SIZE)


def test_a_pose_written_with_few_digits_is_made_rigid(pictures, transforms):
    pose = np.eye(4)
    pose[:3, :3] = [[0.8660, -0.5, 0.0], [0.5, 0.8660, 0.0], [0.0, 0.0, 1.0]]
    transforms(frames=frame(transform_matrix=pose.tolist()))
    (found,) = read_known_poses(pictures, "transforms", *SIZE).camera_to_world
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found, pose * [1, -1, -1, 1], atol=1e-4)


MATCHES = {
    "a path, no extension, a converted picture": (
        ["./images/a 1.png", "b", "sub\\c.jpeg", "gone.png", "d.0001"],
        ["a 1.png", "b.jpg", "c.png", "d.0001.png", "e.png"],
        [0, 1, 2, 4, -1],
    ),
    "two folders with the same name": (
        ["x/2.png", "x/1.png", "y/1.png"],
        ["x/1.png", "y/1.png", "x/2.png"],
        [1, 2, 0],
    ),
    "a folder above": (["images/x/1.png", "/home/me/images/y/1.png"], ["x/1.png", "y/1.png"], [0, 1]),
    "a folder that the file leaves out": (["1.png", "2.png"], ["x/1.png", "y/2.png"], [0, 1]),
    "another folder": (["x/1.png", "y/2.png"], ["x/1.png", "x/2.png"], [0, -1]),
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
    with pytest.raises(UserError, match="none of its 2 names, such as 0.png, 000001.png, .* such as 1.png"):
        match_pictures(["0.png", "000001.png"], ["1.png"], tmp_path)


def test_numbers_beyond_a_video_are_named(tmp_path):
    """Tools that take a video apart count from 1."""
    check_numbers(["00011.png", "other.png"], 12, tmp_path)
    with pytest.raises(UserError, match="00012.png: the video has the frames 0 to 11"):
        check_numbers(["00001.png", "00012.png"], 12, tmp_path)


def entries(count, **changes):
    """Frames along a line, 0.3 apart."""
    poses = [np.eye(4) for _ in range(count)]
    for index, pose in enumerate(poses):
        pose[0, 3] = 0.3 * index
    return [
        {"file_path": f"{i}.png", "transform_matrix": pose.tolist()} | changes for i, pose in enumerate(poses)
    ]


@pytest.mark.parametrize("per_frame", [False, True])
@pytest.mark.parametrize(
    "camera, kind, params",
    [
        ({"distortion_params": [0.1, -0.02, 0.0, 0, 0.01, 0.02]}, "OPENCV", (0.1, -0.02, 0.01, 0.02)),
        (
            {"distortion_params": [0.1, -0.02, 0.3, 0, 0.01, 0.02]},
            "FULL_OPENCV",
            (0.1, -0.02, 0.01, 0.02, 0.3, 0, 0, 0),
        ),
        (
            {"camera_model": "OPENCV_FISHEYE", "distortion_params": [0.01, 0.02, 0.03, 0.04, 0, 0]},
            "OPENCV_FISHEYE",
            (0.01, 0.02, 0.03, 0.04),
        ),
        ({"x_fov": 90.0}, "OPENCV", (0.0,) * 4),
    ],
)
def test_distortion_of_all_frames_or_of_each(pictures, transforms, per_frame, camera, kind, params):
    """nerfstudio's list, whose order is k1 to k4, p1, p2; fields of view in degrees are instant-ngp's."""
    intrinsics = {"fl_x": 32.0, "cx": 32.0, "cy": 24.0} if "x_fov" not in camera else {}
    frames, top = (
        entries(2, **(camera | intrinsics if per_frame else {})),
        {} if per_frame else camera | intrinsics,
    )
    nothing = dict.fromkeys(("camera_model", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"))
    transforms(**nothing | top, frames=frames)
    (lens,) = read_known_poses(pictures, "transforms", *SIZE).lenses
    assert (lens.model, lens.params) == (kind, pytest.approx((32.0, 32.0, 32.0, 24.0, *params)))


def test_keys_that_do_not_count_are_told(pictures, transforms):
    transforms(aabb_scale=16, orientation_override="none", frames=entries(2, colmap_im_id=1, sharpness=9.0))
    unread = read_known_poses(pictures, "transforms", *SIZE).unread
    assert unread == ["aabb_scale", "orientation_override", "colmap_im_id", "sharpness"]


@pytest.mark.parametrize("far", ["one", "all"])
def test_positions_far_from_each_other_or_from_the_origin_are_named(pictures, transforms, far):
    frames = entries(4)
    for index, one in enumerate(frames):
        one["transform_matrix"][1][3] += 4e6 if far == "all" or index == 2 else 0.0
    transforms(frames=frames)
    with pytest.raises(UserError, match=r"transforms.json: \d.png: 4e\+06 from the origin"):
        read_known_poses(pictures, "transforms", *SIZE)
    for one in frames:
        one["transform_matrix"][1][3] = 0.0
        one["transform_matrix"][0][3] *= 1e6
    transforms(frames=frames)
    assert read_known_poses(pictures, "transforms", *SIZE).camera_to_world[3, 0, 3] == pytest.approx(9e5)


def files_of(recording, wanted):
    return [path.relative_to(recording).as_posix() for path in known_pose_files(recording, wanted)]


def test_of_a_colmap_model_three_files_of_one_format_are_read(pictures, model, colmap_folder):
    binary = ["colmap/cameras.bin", "colmap/images.bin", "colmap/points3D.bin"]
    model.write_text(colmap_folder)
    assert files_of(pictures, "auto") == binary
    (colmap_folder / "images.bin").unlink()
    assert files_of(pictures, "colmap") == [name.replace(".bin", ".txt") for name in binary]
    assert files_of(pictures, "none") == files_of(pictures, "transforms") == []


def test_a_transforms_file_names_the_file_of_its_points(pictures, transforms):
    transforms()
    assert files_of(pictures, "auto") == ["transforms.json"]
    transforms(ply_file_path="cloud/points.ply")
    assert files_of(pictures, "auto") == ["transforms.json", "cloud/points.ply"]
