"""Annotations of plain recordings, and the split that depends on them."""

import shutil

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES
from egosplat.errors import UserError
from egosplat.frames import annotations_stage, stage
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import open_recording
from egosplat.frames.plain_annotations import open_annotations
from egosplat.frames.recording import AnnotationKeys, Instance
from egosplat.geometry import Camera
from egosplat.pipeline.config import defaults

OPTIONS = FramesOptions(resolution=32)
CAMERA = Camera(32, 24, 38.4, 38.4, 16.0, 12.0)
TABLE = "id\tname\tcategory\tmotion_type\n5\tBall_1\tball\tdynamic\n300\tTable\tcoffee table\tstatic\n"
IDS = np.zeros((48, 64), np.uint16)
IDS[10:20, 4:14], IDS[30:48] = 5, 300

BALL = np.where(IDS == 5, 5, 0).astype(np.uint8)


@pytest.fixture
def images(tmp_path):
    """Three images, the second and third annotated."""
    folder = tmp_path / "images"
    (folder / "annotations").mkdir(parents=True)
    for number in (1, 2, 10):
        Image.new("RGB", (64, 48)).save(folder / f"img_{number}.jpg")
    (folder / "annotations" / "instances.tsv").write_text(TABLE)
    Image.fromarray(IDS).save(folder / "annotations" / "img_2.png")
    Image.fromarray(BALL).save(folder / "annotations" / "img_10.png")
    return folder


def maps(path):
    times = open_recording(path, OPTIONS).timestamp_ns
    annotations = open_annotations(path, AnnotationKeys(CAMERA))
    return [annotations.read(int(time)) for time in times]


def test_images_have_the_annotation_of_their_name(images):
    expected = np.full((24, 32), -1)
    expected[5:10, 2:7], expected[15:24] = 0, 1
    first, second, third = maps(images)
    assert first is None
    assert second.dtype == np.int32 and (second == expected).all()
    assert (third == np.where(expected == 0, 0, -1)).all()


def split(recording, **keys):
    """The training and evaluation flags of the frames that a stage writes."""
    options = stage.FramesOptions(**defaults()["frames"] | {"resolution": 32} | keys)
    stage.run(recording, recording.parent / "frames.zarr", options, format="plain")
    frames = open_artifact(recording.parent / "frames.zarr", FRAMES)
    return frames.read("train").tolist(), frames.read("evaluation").tolist()


def annotate(images, evaluation):
    """Frames that are all trained on, and the annotations of some."""
    split(images, evaluation_frames=evaluation, holdout=False)
    written = images.parent / "annotations.zarr"
    keys = annotations_stage.AnnotationsOptions()
    annotations_stage.run(images, images.parent / "frames.zarr", written, keys)


def test_evaluation_frames_without_annotation_are_reported(images, capsys):
    annotate(images, 1)
    assert capsys.readouterr().err.endswith("1 of 1 evaluation frames are annotated\n")
    annotate(images, 3)
    assert capsys.readouterr().err.endswith(
        "2 of 3 evaluation frames are annotated; not annotated (indices from 0): 0\n"
    )


def test_without_annotations_every_frame_trains(images, capsys):
    shutil.rmtree(images / "annotations")
    assert split(images) == ([True] * 3, [False] * 3)
    assert "3 frames, all for training" in capsys.readouterr().err
    assert split(images, evaluation_frames=1) == ([True, False, True], [False, True, False])


def test_annotations_without_an_evaluation_frame_are_rejected(images, tmp_path):
    for path in (images / "annotations").glob("*.png"):
        path.unlink()
    with pytest.raises(UserError, match="3 evaluation frames"):
        annotate(images, 3)
    assert not (tmp_path / "annotations.zarr").exists()


def test_instances_are_those_of_the_table(images):
    assert open_annotations(images, AnnotationKeys(CAMERA)).instances == [
        Instance(5, "Ball_1", "ball", "dynamic", "object"),
        Instance(300, "Table", "coffee table", "static", "object"),
    ]
    table = "\ufeffname\tid\tinstance_type\tmotion_type\tcategory\nAnna\t5\thuman\tdynamic\tperson\n"
    (images / "annotations" / "instances.tsv").write_text(table)
    anna = Instance(5, "Anna", "person", "dynamic", "human")
    assert open_annotations(images, AnnotationKeys(CAMERA)).instances == [anna]


def test_video_frames_have_the_annotation_of_their_number(video, tmp_path):
    path = video()
    folder = tmp_path / "clip.mp4.annotations"
    folder.mkdir()
    (folder / "instances.tsv").write_text(TABLE)
    Image.fromarray(IDS).save(folder / "0007.png")
    palette = Image.fromarray(BALL)
    palette.putpalette([90] * 768)
    palette.save(folder / "9.png")
    found = {number: np.unique(one).tolist() for number, one in enumerate(maps(path)) if one is not None}
    assert found == {7: [-1, 0, 1], 9: [-1, 0]}
    Image.fromarray(IDS).save(folder / "12.png")
    with pytest.raises(UserError, match="12.png"):
        maps(path)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("id\tname\tmotion_type\n5\tBall\tdynamic\n", "no column 'category'"),
        ("", "no column 'id'"),
        (TABLE + "5\tBall_2\tball\tdynamic\n", "id 5 is in lines 2 and 4"),
        (TABLE + "0\tBall_2\tball\tdynamic\n", "line 4: id is 0"),
        (TABLE + "x\tBall_2\tball\tdynamic\n", "line 4: id is 'x'"),
        (TABLE + "6\tBall_2\tball\tmoving\n", "line 4: motion_type is 'moving', not static or dynamic"),
        (TABLE + "6\tBall_2\n", "line 4: category"),
    ],
)
def test_bad_tables_are_named(images, table, message):
    (images / "annotations" / "instances.tsv").write_text(table)
    with pytest.raises(UserError, match=f"instances.tsv.*{message}"):
        open_annotations(images, AnnotationKeys(CAMERA))


def test_missing_and_undecodable_tables_are_named(images):
    table = images / "annotations" / "instances.tsv"
    table.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="instances.tsv.*0xff"):
        open_annotations(images, AnnotationKeys(CAMERA))
    table.unlink()
    with pytest.raises(UserError, match="instances.tsv.*No such file"):
        open_annotations(images, AnnotationKeys(CAMERA))


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("img_2.png", Image.fromarray(IDS[:, :-1]), "63x48 px, but the frame is 64x48"),
        ("img_2.png", Image.fromarray(IDS + 1), "instance id 1 is not in instances.tsv"),
        ("img_2.png", Image.new("RGB", (64, 48)), "single channel"),
        ("img_2.png", Image.new("LA", (64, 48)), "single channel"),
        ("img_2.png", None, ""),
        ("img_3.png", Image.fromarray(IDS), ""),
    ],
)
def test_bad_label_images_and_those_of_no_frame_are_named(images, name, image, message):
    (images / "annotations" / name).write_text("no image")
    if image:
        image.save(images / "annotations" / name)
    with pytest.raises(UserError, match=f"{name}.*{message}"):
        maps(images)
