"""LERF-OVS and 3D-OVS: pictures whose labels choose the evaluation frames, on scenes that the test writes in these formats."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from benchmarks.public.boxes import CLASSES, LABELED, PLATES, camera_x, render, write_3d_ovs, write_lerf
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, FRAMES
from egosplat.errors import UserError
from egosplat.evaluation.options import ScoringOptions
from egosplat.evaluation.queries import find_queries, mask_of, read_layers
from egosplat.frames import annotations_stage, stage
from egosplat_rivals.formats.labeled_annotations import match_labels, paint_layers

WRITERS = {"lerf": write_lerf, "3d_ovs": write_3d_ovs}
LABEL, MASKS = "label/boxes/frame_00003.json", "boxes/segmentations"


@pytest.fixture(params=WRITERS)
def format(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def recording(format: str, tmp_path: Path) -> Path:
    return WRITERS[format](tmp_path)


def read(format, recording, **keys):
    made, output = recording.parent / "frames.zarr", recording.parent / "annotations.zarr"
    stage.run(recording, made, stage.FramesOptions(**{"resolution": 96} | keys), format=format)
    annotations_stage.run(recording, made, output, annotations_stage.AnnotationsOptions())
    return open_artifact(made, FRAMES), open_artifact(output, ANNOTATIONS)


def test_labels_choose_the_evaluation_frames_whatever_the_stride(format, recording):
    frames, annotations = read(format, recording, stride=3)
    taken = np.array(sorted({0, 3, 6, *LABELED}))
    assert (frames.read("timestamp_ns") // 10**9 == taken).all() and annotations.read("annotated").all()
    labeled = np.isin(taken, LABELED)
    assert (frames.read("evaluation") == labeled).all() and (frames.read("train") == ~labeled).all()


def test_overlapping_objects_of_lerf_are_whole(tmp_path):
    """The sign lies on the box; each mug is an instance."""
    _, annotations = read("lerf", write_lerf(tmp_path))
    instances = annotations.facts["instances"]
    assert [one["name"] for one in instances] == ["box", "mug 1", "mug 2", "sign"]
    assert {one["motion_type"] for one in instances} == {"static"}
    valid = np.ones((72, 96), bool)
    for row, place in enumerate(LABELED):
        layers = read_layers(annotations, row, valid)
        _, shown = render(camera_x()[place])
        for index, plates in enumerate([(1, 2), (3,), (4,), (2,)]):
            own, visible = mask_of(layers, [index]), np.isin(shown, plates)
            # A polygon has the pixels of its outline, whose corners are cut off to whole pixels.
            around = cv2.dilate(visible.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
            assert own[visible].all() and around[own].all(), (row, index)
        assert len(layers) == 2 and mask_of(layers, [0])[mask_of(layers, [3])].all()
        assert (annotations.row("instance_map", row)[mask_of(layers, [3])] == 3).all()
    queries = find_queries(annotations, valid, ScoringOptions(min_area=0.0))
    assert [(one.row, one.category, one.instances["all"]) for one in queries if one.row == 0] == [
        (0, "box", (0,)), (0, "mug", (1, 2)), (0, "sign", (3,)),
    ]  # fmt: skip


def test_classes_of_3d_ovs_are_exact(tmp_path):
    _, annotations = read("3d_ovs", write_3d_ovs(tmp_path))
    assert [one["category"] for one in annotations.facts["instances"]] == [*CLASSES]
    assert not annotations.has("covered_map")
    for row, place in enumerate(LABELED):
        _, shown = render(camera_x()[place])
        categories = ["box" if one.category == "sign" else one.category for one in PLATES]
        expected = np.array([CLASSES.index(category) for category in categories])[shown]
        assert (annotations.row("instance_map", row) == expected).all()


def test_labels_are_rectified_and_resized_with_their_pictures(format, recording):
    (recording / "sparse/0/cameras.txt").write_text("1 SIMPLE_RADIAL 96 72 90 48 36 0.05\n")
    frames, annotations = read(format, recording, resolution=48)
    assert annotations.shape("instance_map")[1:] == frames.shape("rgb")[1:3] == (36, 48)


NUMBERLESS = ["images/IMG_a.jpg", "images/IMG_b.jpg", "images/IMG_c.jpg"]


def test_a_label_is_of_the_picture_of_its_name_or_of_its_place_where_none_has_a_number():
    labels = {"02": Path("02"), "00": Path("00")}
    assert match_labels(labels, NUMBERLESS) == {0: Path("00"), 2: Path("02")}
    for name, pictures in (("3", NUMBERLESS), ("00", ["1.png", "x.png"]), ("a", ["x/a.png", "y/a.png"])):
        with pytest.raises(UserError, match=f"labels/{name}.*named {name}"):
            match_labels({name: Path("labels") / name}, pictures)


def test_painted_masks_share_layers_where_they_can():
    masks = np.zeros((4, 6, 8), bool)
    masks[0], masks[1, :3, :3], masks[2, 1:2, 1:2], masks[3, 4:, 4:] = True, True, True, True
    layers = paint_layers(enumerate(masks), (6, 8))
    assert len(layers) == 3 and [mask_of(layers, [index]).sum() for index in range(4)] == [48, 9, 1, 8]
    assert all((mask_of(layers, [index]) == mask).all() for index, mask in enumerate(masks))
    assert layers[0, 1, 1] == 2 and layers[0, 0, 0] == 1 and layers[0, 5, 5] == 3


def changed(change):
    """A change of the first label of LERF-OVS."""

    def write(root: Path) -> None:
        document = json.loads((root / LABEL).read_text())
        change(document)
        (root / LABEL).write_text(json.dumps(document))

    return write


def first_object(**keys):
    return changed(lambda document: document["objects"][0].update(keys))


BAD_LABELS = {
    "no label folder": (lambda root: (root / "label").rename(root / "elsewhere"), "label/boxes: has no labels"),
    "no picture": (lambda root: (root / "boxes/images/frame_00003.png").unlink(), "frame_00003.json.* named frame_00003"),
    "two points": (first_object(segmentation=[[1, 1], [5, 5]]), r"objects\[0\] \(box\): segmentation has 2 points"),
    "point at infinity": (first_object(segmentation=[[1, 1], [5, 5], [1e30, 2]]), "segmentation is no pixel"),
    "odd numbers": (first_object(segmentation=[1, 2, 3, 4, 5]), "not a label of LERF-OVS"),
    "no category": (first_object(category=" "), r"objects\[0\]: category is ' '"),
    "no object": (changed(lambda document: document["objects"].clear()), "labels no object"),
    "another size": (changed(lambda document: document["info"].update(width=986)), "986x72 px, which has 96x72"),
    "empty file": (lambda root: (root / LABEL).write_text(""), "not a label of LERF-OVS"),
}  # fmt: skip


def write_mask(width: int, height: int):
    return lambda root: Image.new("L", (width, height)).save(root / MASKS / "02/mug.png")


BAD_MASKS = {
    "no folder": (lambda root: (root / MASKS).rename(root / "elsewhere"), "segmentations: has no folder of masks"),
    "no picture": (lambda root: (root / "boxes/images/02.png").unlink(), "segmentations/02.* named 02"),
    "no classes": (lambda root: (root / MASKS / "classes.txt").unlink(), "classes.txt: not readable"),
    "a class twice": (lambda root: (root / MASKS / "classes.txt").write_text("box\nmug\nmug\nwall"), "class 'mug' twice"),
    "a class without masks": (lambda root: (root / MASKS / "classes.txt").write_text("box\nmug\nsofa\nwall"), "02: has no mask sofa.png"),
    "a mask without class": (lambda root: (root / MASKS / "classes.txt").write_text("box\nwall"), "02/mug.png: not a class"),
    "another size": (write_mask(48, 36), "mug.png: 48x36 px, but its picture has 96x72"),
}  # fmt: skip


BAD = [("lerf", *case) for case in BAD_LABELS.values()] + [("3d_ovs", *case) for case in BAD_MASKS.values()]


@pytest.mark.parametrize(("format", "change", "expected"), BAD)
def test_a_bad_file_is_named(recording, tmp_path, format, change, expected):
    change(tmp_path)
    with pytest.raises(UserError, match=expected) as raised:
        read(format, recording)
    assert len(str(raised.value)) < 400 and str(raised.value).count("\n") < 2


def test_a_class_that_a_picture_does_not_show_has_a_black_mask(tmp_path):
    recording = write_3d_ovs(tmp_path)
    write_mask(96, 72)(tmp_path)
    _, annotations = read("3d_ovs", recording)
    assert [(annotations.row("instance_map", row) == 1).any() for row in (0, 1)] == [False, True]


def test_pictures_in_images_are_found_without_known_poses(tmp_path):
    """As 3D-OVS is published, with poses_bounds.npy alone; COLMAP then finds the poses."""
    recording = write_3d_ovs(tmp_path)
    shutil.rmtree(recording / "sparse")
    frames, annotations = read("3d_ovs", recording, lens="pinhole")
    assert frames.facts["known_poses"] is None and frames.facts["pictures"][0] == "images/00.png"
    assert annotations.read("annotated").all()
