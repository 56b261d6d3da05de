"""Pictures beside known poses: how they lie, a camera for each, masks, transparency, folders."""

import json
import subprocess
import tracemalloc
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pycolmap
import pytest
from PIL import Image

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import shown_pixels
from egosplat.calibration.lens import Lens, Rectifier, shared_pinhole
from egosplat.errors import UserError
from egosplat.frames import annotations_stage, pictures
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import open_recording
from egosplat.gaussians.training_views import open_masking
from egosplat.geometry import Camera
from tests.support.recordings import copy_files, opened
from tests.unit.poses.test_known import run

WIDTH, HEIGHT = 64, 48
OPTIONS = FramesOptions(resolution=64)
NAMES = [f"{number}.png" for number in range(1, 5)]
CAMERA = {"fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "w": WIDTH, "h": HEIGHT}


def picture(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Red grows to the right, green downward."""
    image = np.full((height, width, 3), 90, np.uint8)
    image[..., 0] = np.linspace(20, 220, width)[None]
    image[..., 1] = np.linspace(20, 220, height)[:, None]
    return image


def save(path: Path, image: np.ndarray, orientation: int | None = None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    if orientation:
        exif[0x0112] = orientation
    Image.fromarray(image).save(path, exif=exif)


def write_transforms(folder: Path, names: list[str], camera: dict | None = None, **changes: object) -> None:
    """A camera that moves to the right; ``changes`` of a frame may be a list, with an entry a frame."""
    frames = []
    for index, name in enumerate(names):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[0, 3] = 0.3 * index
        own = {key: value[index] if isinstance(value, list) else value for key, value in changes.items()}
        frames.append({"file_path": name, "transform_matrix": pose.tolist()} | own)
    (folder / "transforms.json").write_text(json.dumps((camera or CAMERA) | {"frames": frames}))


def write_model(folder: Path, names: list[str], cameras: list[str], camera_of: list[int]) -> None:
    """A COLMAP model as text, without points."""
    (folder / "colmap").mkdir(parents=True)
    rows = [f"{i + 1} 1 0 0 0 {-0.3 * i} 0 0 {camera_of[i]} {name}\n\n" for i, name in enumerate(names)]
    lines = {"cameras": [f"{i + 1} {one}\n" for i, one in enumerate(cameras)], "images": rows, "points3D": []}
    for name, content in lines.items():
        (folder / "colmap" / f"{name}.txt").write_text("".join(content))


def write_known(folder: Path, kind: str, names: list[str], width: int = WIDTH, height: int = HEIGHT) -> None:
    """The poses of one camera, in one of the formats."""
    if kind == "colmap":
        write_model(folder, names, [f"PINHOLE {width} {height} 60 60 32 24"], [1] * len(names))
    else:
        write_transforms(folder, names, CAMERA | {"w": width, "h": height})


@pytest.fixture
def folder(tmp_path):
    """Four pictures in a folder."""
    for name in NAMES:
        save(tmp_path / "recording" / name, picture())
    return tmp_path / "recording"


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
@pytest.mark.parametrize("orientation", [2, 3, 6])
@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (WIDTH, WIDTH)])
def test_pictures_lie_as_their_files_have_them(tmp_path, capsys, kind, orientation, size):
    """COLMAP, hloc and nerfstudio ignore EXIF orientation, so it would contradict their poses."""
    image = picture(*size)
    for name in NAMES:
        save(tmp_path / name, image, orientation)
    write_known(tmp_path, kind, NAMES, *size)
    (shown,) = open_recording(tmp_path, OPTIONS).read_frames(np.array([2]))
    np.testing.assert_array_equal(shown, image)
    assert (orientation == 6) == ("as they are stored" not in capsys.readouterr().err)
    (turned,) = open_recording(tmp_path, OPTIONS.change(known_poses="none")).read_frames(np.array([2]))
    assert turned.shape != image.shape or (turned != image).any()


def test_pictures_are_turned_if_only_this_is_the_size_of_their_camera(tmp_path, capsys):
    for name in NAMES:
        save(tmp_path / name, picture(), 6)
    write_transforms(tmp_path, NAMES, CAMERA | {"w": HEIGHT, "h": WIDTH, "cx": 24.0, "cy": 32.0})
    recording = open_recording(tmp_path, OPTIONS)
    (shown,) = recording.read_frames(np.array([0]))
    np.testing.assert_array_equal(shown, np.rot90(picture(), -1))
    assert recording.facts["turned"] and "turned by their EXIF" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_a_camera_of_another_size_is_named(folder, kind):
    write_known(folder, kind, NAMES, 128, 96)
    with pytest.raises(UserError, match=r"(colmap|transforms.json): for 128x96 px, .* 64x48 \(1.png\): give"):
        open_recording(folder, OPTIONS)


def test_two_cameras_become_one_that_both_see(tmp_path):
    lenses = [
        Lens("OPENCV", 64, 48, (60.0, 60.0, 31.0, 25.0, 0.1, 0.0, 0.0, 0.0)),
        Lens("PINHOLE", 96, 128, (110.0, 110.0, 48.0, 64.0)),
    ]
    target = shared_pinhole(lenses, [3, 1])
    views = np.array([lens.inner_view() for lens in lenses]).reshape(-1, 2, 2)
    assert target.fx == pytest.approx(lenses[0].pinhole.fx)
    corners = (np.array([[0, 0], [target.width, target.height]]) - [target.cx, target.cy]) / target.fx
    assert ((views - corners) * [[-1], [1]] >= -1e-9).all()
    for lens in lenses:
        rows, columns = np.mgrid[: lens.height, : lens.width] + 0.5
        rays = lens.colmap().cam_from_img(np.stack([columns.ravel(), rows.ravel()], 1))
        # Brightness is the direction.
        image = np.zeros((lens.height, lens.width, 3), np.uint8)
        image[..., :2] = (128 + 200 * rays).round().reshape(lens.height, lens.width, 2)
        shown = Rectifier(lens, target).image(image).astype(float)
        y, x = np.mgrid[: target.height, : target.width] + 0.5
        np.testing.assert_allclose(shown[..., 0], 128 + 200 * (x - target.cx) / target.fx, atol=1.5)
        np.testing.assert_allclose(shown[..., 1], 128 + 200 * (y - target.cy) / target.fy, atol=1.5)


def test_cameras_without_a_common_view_are_named():
    lenses = [Lens("PINHOLE", 64, 48, (focal, focal, 32.0, 24.0)) for focal in (60.0, 60.0, 1e6)]
    with pytest.raises(UserError, match="3 cameras of the known poses share no view"):
        shared_pinhole(lenses, [1, 1, 1])


def test_several_cameras_reach_frames_poses_and_annotations(tmp_path, capsys):
    recording, names = tmp_path / "recording", ["a.png", "b.png", "c.png"]
    for name in names:
        save(recording / name, picture(*((HEIGHT, WIDTH) if name == "b.png" else (WIDTH, HEIGHT))))
    save(recording / "unknown.png", picture(50, 50))
    cameras = [f"SIMPLE_RADIAL {WIDTH} {HEIGHT} 60 32 24 0.05", f"PINHOLE {HEIGHT} {WIDTH} 60 60 24 32"]
    write_model(recording, names, cameras, [1, 2, 1])
    ids = np.zeros((WIDTH, HEIGHT), np.uint8)
    ids[:, 24:] = 7
    save(recording / "annotations/b.png", ids)
    table = "id\tname\tcategory\tmotion_type\n7\tright\tright\tstatic\n"
    (recording / "annotations/instances.tsv").write_text(table)
    frames, poses = run(recording, {})
    told = capsys.readouterr().err
    assert "2 cameras" in told and "leaves out 1 pictures whose camera is not known" in told
    assert frames.facts["pictures"] == names and frames.facts["lens_of_frame"] == [0, 1, 0]
    camera, valid = Camera(**frames.facts["camera"]), frames.read("valid")
    assert valid.all() and valid.shape == (camera.height, camera.width)
    assert abs(camera.width - camera.height) <= 2 and poses.read("registered").all()
    # The middle of every picture looks ahead.
    middle = frames.read("rgb")[:, round(camera.cy), round(camera.cx), :2]
    assert np.abs(middle.astype(int) - 120).max() <= 5
    keys = annotations_stage.AnnotationsOptions()
    run(recording, {"evaluation_frames": 3, "holdout": False})
    annotations_stage.run(recording, tmp_path / "frames.zarr", tmp_path / "annotations.zarr", keys)
    found = open_artifact(tmp_path / "annotations.zarr", annotations_stage.ANNOTATIONS)
    assert found.read("annotated").tolist() == [False, True, False]
    columns = np.flatnonzero(found.row("instance_map", 1)[0] >= 0)
    assert abs(columns[0] - camera.cx) <= 1 and columns[-1] == camera.width - 1
    save(recording / "valid.png", np.full((HEIGHT, WIDTH), 255, np.uint8))
    with pytest.raises(UserError, match="valid.png: the pictures have several sizes"):
        open_recording(recording, OPTIONS)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_masks_of_frames_are_read(folder, suffix):
    shown = np.ones((4, HEIGHT, WIDTH), bool)
    shown[:, :, :8] = False
    for index in range(4):
        shown[index, 8:24, 16 + 8 * index : 24 + 8 * index] = False
        save(folder / f"masks/{index}.{suffix}", shown[index].astype(np.uint8) * 255)
    write_transforms(folder, NAMES, mask_path=[f"masks/{index}.{suffix}" for index in range(4)])
    frames, _ = run(folder, {})
    valid = frames.read("valid")
    np.testing.assert_array_equal(valid, shown.any(axis=0))
    np.testing.assert_array_equal(frames.read("masked"), valid & ~shown)
    np.testing.assert_array_equal(shown_pixels(frames, 2, valid), shown[2])
    np.testing.assert_array_equal(frames.row("rgb", 1)[valid], picture()[valid])
    assert not frames.row("rgb", 1)[~valid].any()
    masking = open_masking("none", frames, {})
    np.testing.assert_array_equal(masking.frames(np.array([3, 1]))[1].numpy(), valid & ~shown[1])


def test_masks_are_held_packed_and_once():
    mask = np.arange(400 * 800).reshape(400, 800) % 7 > 0
    source = SimpleNamespace(pictures=range(200), path=None)
    shown = {"any_masked": True, "source": source, "size": (800, 400), "shown": partial(np.roll, mask)}
    tracemalloc.start()
    pictures._shared_mask(SimpleNamespace(**shown))
    assert tracemalloc.get_traced_memory()[1] < 1.5 * 200 * mask.size / 8
    tracemalloc.stop()


@pytest.mark.parametrize("known", [False, True])
def test_transparent_pixels_are_not_valid(folder, known):
    alpha = np.full((4, HEIGHT, WIDTH), 255, np.uint8)
    alpha[:, :, :8] = 0
    alpha[1, 10:20, 20:30] = 200
    for index, name in enumerate(NAMES):
        save(folder / name, np.dstack([picture(), alpha[index]]))
    if known:
        write_transforms(folder, NAMES)
    recording = open_recording(folder, OPTIONS.change(lens="pinhole"))
    opaque = alpha == 255
    np.testing.assert_array_equal(recording.valid, opaque.any(axis=0))
    for index in range(4):
        np.testing.assert_array_equal(recording.masked(index), recording.valid & ~opaque[index])
    (shown,) = recording.read_frames(np.array([1]))
    assert not shown[~opaque[1]].any() and (shown[opaque[1]] == picture()[opaque[1]]).all()


LAYOUTS = {
    "nerfstudio's project": ("images/frame_{:05d}.png", "images/frame_{:05d}.png"),
    "blender's names": ("./train/r_{}", "train/r_{}.png"),
    "two folders": ("cam{}/1.png", "cam{}/1.png"),
    "COLMAP's project": ("{}.png", "images/{}.png"),
    "Windows": (".\\images\\{}.png", "images/{}.png"),
    "Windows, from elsewhere": ("./..\\data\\rgb/{}.png", "data/rgb/{}.png"),
    "another computer, whose letters are whole": ("/home/me/k\u00fcche/{}.png", "ku\u0308che/{}.png"),
}


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
@pytest.mark.parametrize("name, file", LAYOUTS.values(), ids=LAYOUTS)
def test_pictures_lie_where_the_known_poses_name_them(tmp_path, kind, name, file):
    recording, files = tmp_path / "recording", [file.format(i) for i in range(4)]
    for path in files:
        save(recording / path, picture())
    save(recording / "images_2/frame_00001.png", picture(32, 24))
    write_known(recording, kind, [name.format(i) for i in range(4)])
    if kind == "colmap" and file == "images/{}.png":
        (recording / "sparse").mkdir()
        (recording / "colmap").rename(recording / "sparse/1")
        write_known(recording, kind, ["0.png"])
        (recording / "colmap").rename(recording / "sparse/0")  # as of a fragment
        with pytest.raises(UserError, match="sparse/1 has more pictures") as caught:
            run(recording, {})
        subprocess.run(str(caught.value).partition("as by: ")[2], shell=True, check=True)
    if kind == "transforms":
        (recording / "colmap").mkdir()  # with nerfstudio's database
    frames, poses = run(recording, {})
    assert frames.facts["pictures"] == files
    np.testing.assert_allclose(poses.read("camera_to_world")[:, 0, 3], [0.0, 0.3, 0.6, 0.9])
    (tmp_path / "copy").mkdir()
    listed = opened("frames", "plain", recording)
    copied = open_recording(copy_files(listed, recording, tmp_path / "copy"), OPTIONS)
    assert frames.facts | json.loads(json.dumps(copied.facts)) == frames.facts


def test_masks_of_instant_ngp_are_no_pictures(folder, capsys):
    """White pixels of ``dynamic_mask_NAME.png`` are left out of the picture NAME; one without a picture is no picture either."""
    moves = np.zeros((HEIGHT, WIDTH), np.uint8)
    moves[8:20, 30:40] = 255
    for name in ("1", "9"):
        save(folder / f"dynamic_mask_{name}.png", moves)
    write_transforms(folder, NAMES)
    frames, _ = run(folder, {})
    assert frames.facts["pictures"] == NAMES and frames.read("valid").all()
    np.testing.assert_array_equal(frames.read("masked"), np.multiply.outer(np.arange(4) == 0, moves > 0))
    assert "1 of 2 dynamic_mask_" in capsys.readouterr().err
    pictures = opened("frames", "plain", folder, "auto")
    assert folder / "dynamic_mask_1.png" in pictures and len(pictures) == len(set(pictures)) == 7
    for name in NAMES:
        save(folder / f"dynamic_mask_{name}", np.full((HEIGHT, WIDTH), 255, np.uint8))
    with pytest.raises(UserError, match="masks leave no pixel.*dynamic_mask_"):
        open_recording(folder, OPTIONS)


def test_what_undistorts_a_camera_that_is_not_supported_makes_a_project(folder):
    write_model(folder, NAMES, [f"FOV {WIDTH} {HEIGHT} 60 60 32 24 0.5"], [1] * 4)
    with pytest.raises(UserError, match="colmap: 1.png: camera FOV is not supported.*image_undistorter"):
        open_recording(folder, OPTIONS)
    pycolmap.undistort_images(folder.parent / "new", folder / "colmap", folder)
    assert open_recording(folder.parent / "new", OPTIONS).camera_known


def test_the_lens_is_looked_for_in_the_pixels_that_a_picture_shows(folder, monkeypatch):
    alpha = np.full((HEIGHT, WIDTH), 255, np.uint8)
    alpha[:, 40:] = 0
    save(folder / "2.png", np.dstack([picture(), alpha]))
    given = []
    monkeypatch.setattr(pictures, "lens_of_frames", lambda *about: given.append(about[-1]))
    open_recording(folder, OPTIONS)
    np.testing.assert_array_equal(given[0](1), alpha > 0)
    assert given[0](2).all()
