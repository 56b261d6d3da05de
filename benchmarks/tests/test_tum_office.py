"""The hand-drawn instances of a real desk: each where it was drawn, in the pictures that are evaluated."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image

from benchmarks.tum_office.__main__ import HERE, Outline, parse_drawing, rasterize, write_recording
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import open_recording
from egosplat.frames.plain_annotations import open_annotations
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.selection import split_frames

DRAWING = parse_drawing(json.loads((HERE / "polygons.json").read_text()))
CONFIG = yaml.safe_load((HERE / "config.yaml").read_text())


def square(id: int, left: int, top: int, right: int, bottom: int) -> Outline:
    return Outline(id, np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.int32))


@pytest.fixture
def pictures(tmp_path):
    """Grey pictures of the names and the size of the recording's."""
    folder = tmp_path / "rgb"
    folder.mkdir()
    for name in [*DRAWING.pictures, "1341847999.000000.png"]:
        Image.new("RGB", (DRAWING.width, DRAWING.height), "grey").save(folder / name)
    return folder


def test_the_pixels_of_an_outline_belong_to_it_and_later_outlines_lie_on_top():
    ids = rasterize([square(7, 1, 1, 5, 4), square(3, 4, 3, 8, 6)], width=10, height=8)
    expected = np.zeros((8, 10))
    expected[1:5, 1:6] = 7
    expected[3:7, 4:9] = 3
    assert ids.shape == (8, 10) and (ids == expected).all()


def test_the_drawn_pictures_are_the_evaluated_ones():
    _, evaluation = split_frames(len(DRAWING.pictures), FramesOptions(**CONFIG["frames"]), True)
    assert [DRAWING.pictures[index] for index in np.flatnonzero(evaluation)] == sorted(DRAWING.outlines)


def test_the_recording_is_read_as_a_plain_one(pictures, tmp_path):
    output = tmp_path / "recording"
    write_recording(pictures, output, DRAWING)
    recording = open_recording(output, FramesOptions(resolution=CONFIG["frames"]["resolution"]))
    capture = recording
    assert capture.camera_known and len(capture.timestamp_ns) == len(DRAWING.pictures)
    # TUM states the center for pixel centers at integers.
    assert (capture.camera.cx, capture.camera.cy) == pytest.approx((320.6, 248.1))
    annotations = open_annotations(output, AnnotationKeys(capture.camera))
    ids = np.array([0, *(instance.id for instance in annotations.instances)])
    for name, time in zip(DRAWING.pictures, capture.timestamp_ns.tolist(), strict=True):
        layers = annotations.read(time)
        if name not in DRAWING.outlines:
            assert layers is None
        else:
            assert (ids[layers[0] + 1] == rasterize(DRAWING.outlines[name], 640, 480)).all()
