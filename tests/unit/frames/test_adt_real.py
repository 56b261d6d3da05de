"""The frames of a real Aria Digital Twin recording of three frames, whole and damaged."""

import shutil

import numpy as np
import pytest

from egosplat.calibration.files import is_annotated
from egosplat.errors import UserError
from egosplat.frames import adt
from egosplat.frames.adt import EXPOSURE_MIDDLE_AFTER_CAPTURE_NS, open_recording
from egosplat.frames.annotations_stage import open_annotations
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.rectify import pinhole
from tests.support.recordings import opened

OPTIONS = FramesOptions(resolution=352, focal=460.0, upright=True)
CAPTURE_NS = [87551170813262, 87551204152300, 87551237472175]


@pytest.fixture(scope="module")
def full_size(sample):
    return open_recording(sample, OPTIONS.change(resolution=1408))


def open_and_read(folder, **options):
    recording = open_recording(folder, OPTIONS.change(**options))
    return list(recording.read_frames(np.arange(len(recording.timestamp_ns))))


def test_the_sample_has_three_color_frames_in_the_lens_circle(full_size):
    capture = full_size
    assert capture.timestamp_ns.tolist() == CAPTURE_NS
    assert (capture.exposure_middle_ns - capture.timestamp_ns == EXPOSURE_MIDDLE_AFTER_CAPTURE_NS).all()
    assert capture.origin == "real" and capture.camera_known
    assert capture.camera == pinhole(1408, 460.0)
    assert 0.74 < capture.valid.mean() < 0.76
    frames = list(full_size.read_frames(np.arange(3)))
    assert [(image.shape, image.dtype.name) for image in frames] == [((1408, 1408, 3), "uint8")] * 3
    for image in frames:
        assert (image[~capture.valid] == 0).all()
        assert 40 < image[capture.valid].mean() < 120
    # 33 ms apart, the same room: neighbors differ, but less than a image and its mirror image.
    change = np.abs(frames[0].astype(int) - frames[1]).mean()
    assert 0 < change < 0.3 * np.abs(frames[0].astype(int) - frames[0][:, ::-1]).mean()


def test_a_recording_of_arias_own_tools_has_another_name(copy):
    """Aria Everyday Activities and Aria's tools call the file recording.vrs, and annotate nothing."""
    before = open_and_read(copy)
    (copy / "video.vrs").rename(copy / "recording.vrs")
    (copy / "metadata.json").unlink()
    assert all(np.array_equal(one, other) for one, other in zip(before, open_and_read(copy), strict=True))
    assert [path.name for path in opened("frames", "adt", copy)] == ["recording.vrs"]
    reader = open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))
    assert reader.instance_map(CAPTURE_NS[0]) is not None
    for path in copy.glob("segmentations*.vrs"):
        path.unlink()
    assert not is_annotated("adt", copy) and is_annotated("adt", copy / "not rendered yet")
    assert open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0))) is None


def test_stride_and_range_select_frames(sample):
    assert open_recording(sample, OPTIONS.change(stride=2)).timestamp_ns.tolist() == CAPTURE_NS[::2]
    late = open_recording(sample, OPTIONS.change(start_s=0.02))
    assert late.timestamp_ns.tolist() == CAPTURE_NS[1:]
    first, second = open_recording(sample, OPTIONS).read_frames(np.array([0, 2]))
    assert (second == next(late.read_frames(np.array([1])))).all() and (first != second).any()
    with pytest.raises(UserError, match="no frame"):
        open_recording(sample, OPTIONS.change(start_s=1.0))


def test_origin_follows_the_metadata(copy):
    (copy / "metadata.json").write_text('{"origin": "synthetic"}')
    assert open_recording(copy, OPTIONS).origin == "synthetic"
    (copy / "metadata.json").write_text("{")
    with pytest.raises(UserError, match="metadata.json.*JSON"):
        open_recording(copy, OPTIONS)


@pytest.mark.parametrize("keep", [40, 1_000_000, 1_080_750, -1])
def test_a_truncated_video_is_rejected(copy, keep):
    content = (copy / "video.vrs").read_bytes()
    (copy / "video.vrs").write_bytes(content[:keep])
    with pytest.raises(UserError, match="video.vrs"):
        open_recording(copy, OPTIONS)


def test_another_vrs_file_is_rejected(copy):
    shutil.copyfile(copy / "segmentations.vrs", copy / "video.vrs")
    with pytest.raises(UserError, match="video.vrs.*RGB"):
        open_recording(copy, OPTIONS)


def test_a_damaged_frame_is_named(copy):
    content = bytearray((copy / "video.vrs").read_bytes())
    content[800_000:801_000] = bytes(byte ^ 0xFF for byte in content[800_000:801_000])
    (copy / "video.vrs").write_bytes(content)
    with pytest.raises(UserError, match="video.vrs: RGB frame 1"):
        open_and_read(copy)


def test_missing_videos_are_named(copy):
    (copy / "video.vrs").unlink()
    with pytest.raises(UserError, match="video.vrs"):
        open_recording(copy, OPTIONS)
    with pytest.raises(UserError, match="nowhere"):
        open_recording(copy / "nowhere", OPTIONS)


def test_a_black_frame_is_named(sample, monkeypatch):
    recording = open_recording(sample, OPTIONS)
    monkeypatch.setattr(adt, "read_checked", lambda *_: np.zeros((1408, 1408, 3), np.uint8))
    with pytest.raises(UserError, match="frame 2 .*black"):
        next(recording.read_frames(np.array([2])))
