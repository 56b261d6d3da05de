"""Recordings open by format, and reading frames imports no annotation code."""

import pytest

from egosplat.errors import UserError
from egosplat.frames.annotations_stage import open_annotations
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.stage import open_recording
from egosplat.geometry import Camera

OPTIONS = FramesOptions(resolution=32, focal=460.0, upright=True)
CAMERA = Camera(32, 24, 30.0, 30.0, 16.0, 12.0)


def test_an_unknown_format_is_rejected(tmp_path):
    with pytest.raises(UserError, match="'aria'.*hoi4d"):
        open_recording("aria", tmp_path, OPTIONS)
    with pytest.raises(UserError, match="'aria'"):
        open_annotations("aria", tmp_path, AnnotationKeys(CAMERA, True))


@pytest.mark.parametrize(
    "format, problem",
    [
        ("adt", "no such folder"),
        ("hoi4d", "not the name of a HOI4D sequence"),
        ("plain", "not found"),
        ("lerf", "no such folder"),
        ("3d_ovs", "no such folder"),
    ],
)
def test_a_missing_recording_is_named_with_the_reason(tmp_path, format, problem):
    nowhere = tmp_path / "nowhere"
    with pytest.raises(UserError, match=f"nowhere: {problem}"):
        open_recording(format, nowhere, OPTIONS)
    with pytest.raises(UserError, match=f"nowhere: {problem}"):
        open_annotations(format, nowhere, AnnotationKeys(CAMERA, True))
