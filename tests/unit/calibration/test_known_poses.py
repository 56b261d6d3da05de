"""Known poses are read as they are, and a damaged or unfit file is named with what is wrong."""

import json
import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from egosplat.calibration.known_poses import find_known_poses, match_pictures, read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError

WIDTH, HEIGHT = 64, 48
SIZE = (WIDTH, HEIGHT)


def true_pose(model: pycolmap.Reconstruction, name: str) -> np.ndarray:
    (image,) = [one for one in model.images.values() if one.name == name]
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().inverse().matrix()
    return pose


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_a_colmap_model_is_read_as_it_is(pictures, model, colmap_folder, suffix):
    """Poses, camera and points to rounding, from both of COLMAP's formats."""
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    (model.write_binary if suffix == ".bin" else model.write_text)(colmap_folder)
    contents = read_known_poses(pictures, "colmap", *SIZE)
    assert contents.lenses == [Lens("RADIAL", WIDTH, HEIGHT, (60.0, 31.0, 25.0, 0.05, -0.01))]
    assert sorted(contents.names) == [f"{number}.png" for number in range(1, 7)]
    for name, pose in zip(contents.names, contents.camera_to_world, strict=True):
        np.testing.assert_allclose(pose, true_pose(model, name), atol=1e-12)
    assert contents.points.shape == (30, 3) and contents.point_views.min() >= 2


def test_a_transforms_file_is_turned_from_opengl(pictures, model, transforms):
    """The axes: a picture's y points up and its z backward in the file."""
    transforms(applied_transform=[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], applied_scale=0.5)
    contents = read_known_poses(pictures, "transforms", *SIZE)
    assert contents.lenses == [Lens("OPENCV", WIDTH, HEIGHT, (60.0, 60.0, 31.0, 25.0, 0.05, -0.01, 0.0, 0.0))]
    for name, pose in zip(contents.names, contents.camera_to_world, strict=True):
        np.testing.assert_allclose(pose, true_pose(model, Path(name).name), atol=1e-12)
    assert contents.notes["applied_scale"] == 0.5 and len(contents.notes["applied_transform"]) == 3


@pytest.mark.parametrize(
    "changes, lens",
    [
        ({"camera_model": None, "is_fisheye": True}, ("OPENCV_FISHEYE", (0.05, -0.01, 0.0, 0.0))),
        ({"k3": 0.3}, ("FULL_OPENCV", (0.05, -0.01, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0))),
        ({"w": None, "h": None, "k1": None, "k2": None}, ("OPENCV", (0.0, 0.0, 0.0, 0.0))),
    ],
    ids=["instant-ngp's fisheye", "sixth order", "no size and no distortion"],
)
def test_lenses_of_transforms_files(pictures, transforms, changes, lens):
    """Spellings of other tools are read, not guessed."""
    transforms(**changes)
    found = read_known_poses(pictures, "transforms", *SIZE).lenses
    assert found == [Lens(lens[0], WIDTH, HEIGHT, (60.0, 60.0, 31.0, 25.0, *lens[1]))]


def test_a_field_of_view_gives_the_focal_length(pictures, transforms):
    """Blender's files have an angle alone."""
    transforms(fl_x=None, fl_y=None, cx=None, cy=None, camera_angle_x=np.pi / 2)
    assert read_known_poses(pictures, "transforms", *SIZE).lenses[0].params[:4] == pytest.approx((32, 32, 32, 24))


@pytest.mark.parametrize("binary", [True, False])
def test_points_of_a_transforms_file(pictures, transforms, binary):
    """nerfstudio writes its points to a PLY file beside it."""
    table = np.array(
        [(1.0, 2.0, 3.0, 9, 8, 7), (-1.0, 0.5, 0.0, 255, 0, 1)],
        dtype=[*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name in ("red", "green", "blue"))],
    )
    kind = "binary_little_endian" if binary else "ascii"
    lines = ["ply", f"format {kind} 1.0", "element vertex 2", *(f"property float {axis}" for axis in "xyz")]
    lines += [*(f"property uchar {name}" for name in ("red", "green", "blue")), "end_header", ""]
    body = (
        table.tobytes() if binary else "\n".join(" ".join(map(str, row)) for row in table.tolist()).encode()
    )
    (pictures / "cloud.ply").write_bytes("\n".join(lines).encode() + body)
    transforms(ply_file_path="cloud.ply")
    contents = read_known_poses(pictures, "transforms", *SIZE)
    np.testing.assert_array_equal(contents.points, [[1, 2, 3], [-1, 0.5, 0]])
    np.testing.assert_array_equal(contents.point_rgb, [[9, 8, 7], [255, 0, 1]])
    (pictures / "cloud.ply").write_bytes((pictures / "cloud.ply").read_bytes()[:-6])
    with pytest.raises(UserError, match="cloud.ply: not a readable PLY"):
        read_known_poses(pictures, "transforms", *SIZE)


def test_the_format_is_found_or_named(pictures, colmap_folder, transforms):
    """Two files are a choice of the user's, and a named file that is not there is an error."""
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
def test_a_text_file_of_something_else_is_named(pictures, model, colmap_folder, name, content):
    """No traceback of COLMAP's."""
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    model.write_text(colmap_folder)
    (colmap_folder / f"{name}.txt").write_bytes(content)
    with pytest.raises(UserError, match="colmap: not a readable COLMAP model") as caught:
        read_known_poses(pictures, "colmap", *SIZE)
    assert "/tmp/egosplat-model" not in str(caught.value)


def test_a_folder_without_a_model_is_named(pictures, colmap_folder):
    """A project folder instead of a model folder, or a file that was not copied."""
    (colmap_folder / "images.bin").unlink()
    with pytest.raises(UserError, match="colmap: has no images.bin. A COLMAP model has"):
        read_known_poses(pictures, "colmap", *SIZE)


def test_a_model_with_two_cameras_is_rejected(pictures, model, colmap_folder):
    """Rectified frames have one camera; the error names COLMAP's flag."""
    other = pycolmap.Camera(model="RADIAL", width=WIDTH, height=HEIGHT, params=[61.0, 31.0, 25.0, 0.0, 0.0])
    other.camera_id = 2
    model.add_camera_with_trivial_rig(other)
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    model.write_text(colmap_folder)
    for name in ("rigs.txt", "frames.txt"):
        (colmap_folder / name).unlink()
    text = (colmap_folder / "images.txt").read_text().replace(" 1 3.png", " 2 3.png")
    (colmap_folder / "images.txt").write_text(text)
    with pytest.raises(UserError, match="colmap: has 2 cameras, .*single_camera"):
        read_known_poses(pictures, "colmap", *SIZE)


def test_an_unsupported_model_of_colmap_is_named(pictures, model, colmap_folder):
    """The error names the file and what is supported."""
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    model.write_text(colmap_folder)
    (colmap_folder / "cameras.txt").write_text(f"1 FOV {WIDTH} {HEIGHT} 60 60 31 25 0.9\n")
    with pytest.raises(UserError, match="cameras.txt: camera model FOV is not supported.*OPENCV_FISHEYE"):
        read_known_poses(pictures, "colmap", *SIZE)


@pytest.mark.parametrize("numbers", ["0 0 0 0 1 2 3", "1 0 0 0 1e999 2 3"], ids=["no rotation", "infinite"])
def test_a_pose_that_is_not_a_number_is_named(pictures, model, colmap_folder, numbers):
    """pycolmap takes a quaternion of zeros for no rotation."""
    shutil.rmtree(colmap_folder)
    colmap_folder.mkdir()
    model.write_text(colmap_folder)
    lines = (colmap_folder / "images.txt").read_text().splitlines()
    at = next(index for index, line in enumerate(lines) if line.endswith("3.png"))
    words = lines[at].split()
    lines[at] = " ".join([words[0], numbers, *words[8:]])
    (colmap_folder / "images.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match="images.txt: 3.png: the pose|not a readable COLMAP model"):
        read_known_poses(pictures, "colmap", *SIZE)


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_a_camera_of_another_size_is_named(pictures, colmap_folder, transforms, kind):
    """Pictures that were made smaller after the reconstruction."""
    transforms()
    with pytest.raises(
        UserError, match=r"(cameras.bin|transforms.json): for 64x48 px, but the frames are 32x24"
    ):
        read_known_poses(pictures, kind, 32, 24)


def frame(**changes: object) -> list[dict[str, object]]:
    return [{"file_path": "images/1.png", "transform_matrix": np.eye(4).tolist()} | changes]


SCALED = np.diag([2.0, 2.0, 2.0, 1.0]).tolist()
MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0]).tolist()


@pytest.mark.parametrize(
    "changes, problem",
    [
        ({"frames": None}, "has no list 'frames'"),
        ({"frames": []}, "has no list 'frames'"),
        ({"frames": frame(file_path=None)}, r"frames\[0\]: file_path"),
        (
            {"frames": frame(transform_matrix=[[1, 0], [0, 1]])},
            "images/1.png: transform_matrix is not 4 rows",
        ),
        ({"frames": frame(transform_matrix="x")}, "images/1.png: transform_matrix is not 4 rows"),
        ({"frames": frame(transform_matrix=SCALED)}, "images/1.png: the pose is not a rotation"),
        ({"frames": frame(transform_matrix=MIRRORED)}, "images/1.png: the pose is not a rotation"),
        ({"frames": frame(transform_matrix=[[float("nan")] * 4] * 4)}, "images/1.png: the pose has a value"),
        ({"frames": [*frame(), *frame(fl_x=70.0)]}, "has another camera than images/1.png"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model EQUIRECTANGULAR is not supported"),
        ({"fl_x": None}, "has neither fl_x nor camera_angle_x"),
        ({"fl_x": "wide"}, "fl_x is wide, not a finite number"),
        ({"fl_x": 10**400}, "fl_x is 1000"),
        ({"k1": float("nan")}, "k1 is nan"),
        ({"k4": 0.1}, "k4 is not supported"),
        ({"w": 64.5}, "w and h are 64.5"),
        ({"fl_x": -60.0}, "fx, fy must be positive"),
        ({"cx": 100.0}, r"\(cx, cy\) inside"),
        (
            {"applied_transform": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]},
            "applied_transform is not a rotation",
        ),
        ({"applied_scale": 0}, "applied_scale is 0, not a positive"),
        ({"ply_file_path": "nowhere.ply"}, "nowhere.ply: not a readable PLY"),
        ({"ply_file_path": 3}, "ply_file_path"),
    ],
)
def test_a_bad_transforms_file_is_named(pictures, transforms, changes, problem):
    """One line that names the file and the key or the picture."""
    transforms(**changes)
    if "frames" in changes and changes["frames"] is None:
        path = pictures / "transforms.json"
        document = json.loads(path.read_text())
        path.write_text(json.dumps({key: value for key, value in document.items() if key != "frames"}))
    with pytest.raises(UserError, match=problem) as caught:
        read_known_poses(pictures, "transforms", *SIZE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "[" * 5000])
def test_a_transforms_file_that_is_no_object_is_named(pictures, text):
    """Damaged JSON."""
    (pictures / "transforms.json").write_text(text)
    with pytest.raises(UserError, match="transforms.json: "):
        read_known_poses(pictures, "transforms", *SIZE)


def test_a_pose_written_with_few_digits_is_made_rigid(pictures, transforms):
    """Some tools write four digits; the nearest rotation is within them."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.8660, -0.5, 0.0], [0.5, 0.8660, 0.0], [0.0, 0.0, 1.0]]
    transforms(frames=frame(transform_matrix=pose.tolist()))
    (found,) = read_known_poses(pictures, "transforms", *SIZE).camera_to_world
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found, pose * [1, -1, -1, 1], atol=1e-4)


def test_names_match_pictures_without_folder_and_extension(tmp_path):
    """What tools write for one picture: a path, a name without extension, a converted picture, a frame number."""
    names = ["./images/a 1.png", "b", "sub\\c.jpeg", "00012.png", "gone.png"]
    match = match_pictures(names, ["a 1.png", "b.jpg", "c.png", "12", "d.png"], tmp_path)
    assert match.row.tolist() == [0, 1, 2, 3, -1]
    assert match.unmatched == ["gone.png"]


def test_names_that_match_twice_or_never_are_named(tmp_path):
    """A file of another recording, or of two cameras with equal names."""
    with pytest.raises(UserError, match="left/1.png and right/1.png are both the picture 1.png"):
        match_pictures(["left/1.png", "right/1.png"], ["1.png"], tmp_path)
    with pytest.raises(UserError, match="none of its 2 names, such as a.png, b.png, .* such as 1.png"):
        match_pictures(["a.png", "b.png"], ["1.png"], tmp_path)
