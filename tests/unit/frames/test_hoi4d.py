"""HOI4D recordings and annotations, on sequences that the test writes in the dataset's layout."""

import cv2
import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.frames.hoi4d import COLORS, decode_labels, instances_of, open_annotations, open_recording
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.geometry import Camera

NAME = "ZY20210800001_H1_C11_N58_S376_s02_T2"
FOLDER = NAME.replace("_", "/")
OPTIONS = FramesOptions(resolution=32)
CAMERA = Camera(32, 24, 25.0, 25.0, 16.0, 12.0)
MATRIX = np.array([[50.0, 0.0, 31.5], [0.0, 51.0, 23.5], [0.0, 0.0, 1.0]])


@pytest.fixture
def root(tmp_path, video):
    """A dataset of one sequence: 12 frames of 64 x 48, masks of frames 0 and 3."""
    video(f"{FOLDER}/align_rgb/image.mp4")
    write_intrinsics(tmp_path, MATRIX)
    labels = np.zeros((48, 64), dtype=int)
    labels[8:16, 4:12], labels[20:28, 40:48] = 1, 2
    for number in (0, 3):
        write_mask(tmp_path / FOLDER / f"2Dseg/mask/{number:05d}.png", np.roll(labels, number, axis=1))
    return tmp_path


def write_intrinsics(root, matrix):
    (root / "camera_params" / "ZY20210800001").mkdir(parents=True, exist_ok=True)
    np.save(root / "camera_params" / "ZY20210800001" / "intrin.npy", matrix)


def write_mask(path, labels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(COLORS.astype(np.uint8)[labels]).save(path)


def test_colors_of_the_voc_palette_are_decoded_and_unknown_ones_marked():
    bits = [(number & 1, number >> 1 & 1, number >> 2) for number in range(7)]
    assert COLORS.tolist() == [[128 * bit for bit in row] for row in bits]
    labels = np.arange(7).reshape(1, 7)
    assert (decode_labels(COLORS.astype(np.uint8)[labels]) == labels).all()
    assert decode_labels(np.array([[[1, 2, 3], [64, 0, 0]]], dtype=np.uint8)).tolist() == [[-1, -1]]


def test_frames_are_scaled_with_their_camera(root):
    recording = open_recording(root / FOLDER, OPTIONS)
    # intrin.npy has pixel centers at the integer: 31.5 there is the middle, 32, here, and 16 at half size.
    assert recording.camera == Camera(32, 24, 25.0, 25.5, 16.0, 12.0)
    assert recording.camera_known and recording.device_from_camera is None and recording.valid.all()
    assert np.abs(recording.timestamp_ns - np.arange(12) * 1e9 / 15).max() < 1000
    (image,) = recording.read_frames(np.array([7]))
    assert image.shape == (24, 32, 3) and abs(int(image[12, 28, 1]) - 70) <= 3 and image[12, 4, 0] > 200


def test_videos_and_annotations_may_have_separate_root_folders(root):
    release = root / "HOI4D_release" / FOLDER
    release.parent.mkdir(parents=True)
    (root / FOLDER).rename(release)
    annotations = root / "HOI4D_annotations" / FOLDER
    annotations.mkdir(parents=True)
    (release / "2Dseg").rename(annotations / "2Dseg")
    assert open_recording(root / NAME, OPTIONS).camera_known
    assert open_annotations(root / NAME, AnnotationKeys(CAMERA)).read(0) is not None


def test_masks_belong_to_their_frames(root):
    annotations = open_annotations(root / FOLDER, AnnotationKeys(CAMERA))
    capture = open_recording(root / FOLDER, OPTIONS)
    maps = [annotations.read(int(time)) for time in capture.timestamp_ns]
    assert [index for index, found in enumerate(maps) if found is not None] == [0, 3]
    expected = np.full((24, 32), -1)
    expected[4:8, 2:6], expected[10:14, 20:24] = 0, 1
    assert maps[0].dtype == np.int32 and np.array_equal(maps[0][0], expected)
    assert annotations.read(int(capture.timestamp_ns[3]) + 3_100_000) is None


def test_the_meaning_of_labels_depends_on_the_category(root):
    pliers = [instance.category for instance in instances_of("C11", root)]
    assert pliers[:3] == ["left part of the pliers", "right hand", "right part of the pliers"]
    assert pliers[3:] == ["pliers"] * 3
    assert [instance.category for instance in instances_of("C7", root)[:3]] == ["bowl", "right hand", "ball"]
    for category in ("C1", "C8", "C20"):
        instances = instances_of(category, root)
        assert {instance.motion_type for instance in instances} == {"dynamic"}
        assert len({instance.name for instance in instances}) == 6
        assert all((one.instance_type == "human") == ("hand" in one.category.split()) for one in instances)
    with pytest.raises(UserError, match="C10"):
        instances_of("C10", root)


@pytest.mark.parametrize(
    "matrix, problem",
    [
        *((matrix, "no intrinsics") for matrix in (np.eye(4), np.full((3, 3), np.nan), np.zeros((3, 3)))),
        (MATRIX + np.array([[0, 9, 0], [0, 0, 0], [0, 0, 0]]), "no intrinsics"),
        (MATRIX * [[30], [1], [1]], "of 64x48 px"),
        (MATRIX * [[1e-3], [1e-3], [1]], "in pixels"),
        *((np.array(each), "not a readable NumPy array") for each in (["a", "b"], [{"fx": 1}])),
    ],
)
def test_bad_intrinsics_are_named(root, matrix, problem):
    write_intrinsics(root, matrix)
    with pytest.raises(UserError, match=f"intrin.npy: .*{problem}"):
        open_recording(root / FOLDER, OPTIONS)


def test_missing_parts_and_a_resolution_above_the_video_are_named(root):
    with pytest.raises(UserError, match="sequence"):
        open_recording(root / NAME.replace("H1", "H9"), OPTIONS)
    with pytest.raises(UserError, match="resolution: 65 .*image.mp4 .*64"):
        open_recording(root / FOLDER, OPTIONS.change(resolution=65))
    intrinsics = root / "camera_params/ZY20210800001/intrin.npy"
    intrinsics.write_bytes(b"\x93NUMPY\1\0\4\0(((\n")
    with pytest.raises(UserError, match="intrin.npy: not a readable NumPy array"):
        open_recording(root / FOLDER, OPTIONS)
    intrinsics.unlink()
    with pytest.raises(UserError, match="camera_params/ZY20210800001/intrin.npy"):
        open_recording(root / FOLDER, OPTIONS)
    (root / FOLDER / "align_rgb/image.mp4").unlink()
    with pytest.raises(UserError, match="image.mp4"):
        open_recording(root / FOLDER, OPTIONS)


def test_bad_masks_are_named(root):
    mask = root / FOLDER / "2Dseg/mask/00000.png"
    annotations = open_annotations(root / FOLDER, AnnotationKeys(CAMERA))
    write_mask(mask, np.zeros((48, 48), dtype=int))
    with pytest.raises(UserError, match="00000.png.*aspect"):
        annotations.read(0)
    cv2.imwrite(str(mask), np.full((48, 64, 3), 77, np.uint8))
    with pytest.raises(UserError, match="00000.png.*label"):
        annotations.read(0)
    mask.write_bytes(mask.read_bytes()[:60])
    with pytest.raises(UserError, match="00000.png"):
        annotations.read(0)
