"""Boxes and outlines that were drawn by hand in real pictures, and what they say of things."""

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from benchmarks.real_pictures.boxes import is_one, read_boxes
from benchmarks.real_pictures.desk import CAMERA, DRAWN, HERE, rasterize, write_recording
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import open_recording
from egosplat.frames.plain_annotations import open_annotations
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.selection import split_frames

CONFIG = yaml.safe_load((HERE / "config.yaml").read_text())


@pytest.fixture
def pictures(tmp_path):
    """Grey pictures of the names and the size of the recording's."""
    folder = tmp_path / "rgb"
    folder.mkdir()
    for name in [*DRAWN["pictures"], "1341847999.000000.png"]:
        Image.new("RGB", (CAMERA["width"], CAMERA["height"]), "grey").save(folder / name)
    return folder


def test_the_drawn_pictures_are_the_evaluated_ones():
    _, evaluation = split_frames(len(DRAWN["pictures"]), FramesOptions(**CONFIG["frames"]), True)
    assert [DRAWN["pictures"][index] for index in np.flatnonzero(evaluation)] == sorted(DRAWN["polygons"])


def test_the_recording_is_read_as_a_plain_one(pictures, tmp_path):
    output = tmp_path / "recording"
    write_recording(pictures, output)
    recording = open_recording(output, FramesOptions(resolution=CONFIG["frames"]["resolution"]))
    capture = recording
    assert capture.camera_known and len(capture.timestamp_ns) == len(DRAWN["pictures"])
    # TUM states the center for pixel centers at integers.
    assert (capture.camera.cx, capture.camera.cy) == pytest.approx((320.6, 248.1))
    annotations = open_annotations(output, AnnotationKeys(capture.camera))
    ids = np.array([0, *(instance.id for instance in annotations.instances)])
    for name, time in zip(DRAWN["pictures"], capture.timestamp_ns.tolist(), strict=True):
        layers = annotations.read(time)
        if name not in DRAWN["polygons"]:
            assert layers is None
        else:
            assert (ids[layers[0] + 1] == rasterize(DRAWN["polygons"][name], 640, 480)).all()


def test_a_thing_is_of_the_name_whose_box_fits_it_best_in_the_frame_that_shows_most_of_it():
    rows = [(1, "table", (0, 0, 100, 100)), (1, "cup", (40, 40, 60, 60)), (2, "cup", (0, 0, 50, 50))]
    boxes = pd.DataFrame(rows, columns=["frame", "name", "box"])
    cup, table, nothing = np.zeros((3, 100, 100), bool)
    cup[40:60, 40:60], table[:, 10:] = True, True
    assert [is_one({1: cup, 2: nothing}, boxes, name) for name in ("cup", "table")] == [True, False]
    assert [is_one({1: table, 2: cup}, boxes, name) for name in ("cup", "table")] == [False, True]
    assert is_one({1: nothing}, boxes, "cup") is None


def test_questions_name_boxed_things_or_nothing_and_ten_of_each():
    questions = pd.read_csv(HERE / "questions.tsv", sep="\t", keep_default_na=False)
    for recording, own in questions.groupby("recording"):
        boxes = read_boxes(str(recording))
        assert {*own["name"]} - {""} <= {*boxes["name"]}
        assert min((own["name"] == "").sum(), (own["name"] != "").sum()) >= 10
        assert (boxes["left"] < boxes["right"]).all() and (boxes["top"] < boxes["bottom"]).all()
