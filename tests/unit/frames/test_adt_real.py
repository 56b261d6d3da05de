"""A real Aria Digital Twin recording of three frames, of which two are annotated, whole and damaged."""

import json
import os
import shutil

import numpy as np
import pytest

from egosplat.calibration.files import is_annotated
from egosplat.errors import UserError
from egosplat.frames import adt
from egosplat.frames.adt import EXPOSURE_MIDDLE_AFTER_CAPTURE_NS, open_recording
from egosplat.frames.adt_annotations import open_annotations
from egosplat.frames.native_log import captured_log
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.rectify import pinhole
from tests.support.recordings import opened

OPTIONS = FramesOptions(resolution=352, upright=True)
CAPTURE_NS = [87551170813262, 87551204152300, 87551237472175]
ANNOTATION_NS = [87551170910000, 87551204237999]


def open_and_read(folder):
    recording = open_recording(folder, OPTIONS)
    return list(recording.read_frames(np.arange(len(recording.timestamp_ns))))


def first_map(folder):
    """The annotations, and the instance map of the first frame."""
    reader = open_annotations(folder, AnnotationKeys(pinhole(352)))
    return reader, reader and reader.read(CAPTURE_NS[0])


def test_the_sample_has_three_color_frames_in_the_lens_circle(full_size):
    assert full_size.timestamp_ns.tolist() == CAPTURE_NS
    assert (full_size.exposure_middle_ns - full_size.timestamp_ns == EXPOSURE_MIDDLE_AFTER_CAPTURE_NS).all()
    assert full_size.origin == "real" and full_size.camera_known
    assert full_size.camera == pinhole(1408)
    assert 0.74 < full_size.valid.mean() < 0.76
    frames = list(full_size.read_frames(np.arange(3)))
    assert [(image.shape, image.dtype.name) for image in frames] == [((1408, 1408, 3), "uint8")] * 3
    for image in frames:
        assert (image[~full_size.valid] == 0).all()
        assert 40 < image[full_size.valid].mean() < 120
    # 33 ms apart, the same room: neighbors differ, but less than a image and its mirror image.
    change = np.abs(frames[0].astype(int) - frames[1]).mean()
    assert 0 < change < 0.3 * np.abs(frames[0].astype(int) - frames[0][:, ::-1]).mean()


def test_a_recording_of_arias_own_tools_has_another_name(copy):
    """Aria Everyday Activities and Aria's tools call the file recording.vrs, and annotate nothing."""
    before = open_and_read(copy)
    (copy / "video.vrs").rename(copy / "recording.vrs")
    (copy / "metadata.json").unlink()
    assert np.array_equal(before, open_and_read(copy))
    assert [path.name for path in opened("frames", "adt", copy)] == ["recording.vrs"]
    assert first_map(copy)[1] is not None
    for path in copy.glob("segmentations*.vrs"):
        path.unlink()
    assert not is_annotated("adt", copy) and is_annotated("adt", copy / "not rendered yet")
    assert first_map(copy) == (None, None)


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


def write_inverted(path, start, end):
    content = bytearray(path.read_bytes())
    content[start:end] = bytes(byte ^ 0xFF for byte in content[start:end])
    path.write_bytes(content)


BAD_VIDEOS = {
    **{
        f"cut to {end}": (lambda path, end=end: path.write_bytes(path.read_bytes()[:end]), "")
        for end in (40, 1_000_000, 1_080_750, -1)
    },
    "another": (lambda path: shutil.copyfile(path.with_name("segmentations.vrs"), path), ".*RGB"),
    "damaged": (lambda path: write_inverted(path, 800_000, 801_000), ": RGB frame 1"),
    "missing": (lambda path: path.unlink(), ""),
}


@pytest.mark.parametrize("damage, problem", BAD_VIDEOS.values(), ids=BAD_VIDEOS)
def test_a_bad_video_is_named(copy, damage, problem):
    damage(copy / "video.vrs")
    with pytest.raises(UserError, match=f"video.vrs{problem}"):
        open_and_read(copy)


def test_a_black_frame_is_named(sample, monkeypatch):
    recording = open_recording(sample, OPTIONS)
    monkeypatch.setattr(adt, "read_checked", lambda *_: np.zeros((1408, 1408, 3), np.uint8))
    with pytest.raises(UserError, match="frame 2 .*black"):
        next(recording.read_frames(np.array([2])))


@pytest.fixture(scope="module")
def annotations(sample, full_size):
    return open_annotations(sample, AnnotationKeys(full_size.camera, True))


def test_instances_are_read_with_their_categories(annotations):
    instances = annotations.instances
    assert len(instances) == 350
    assert [sum(one.motion_type == kind for one in instances) for kind in ("static", "dynamic")] == [304, 46]
    assert len({one.category for one in instances}) == 106
    assert [one.name for one in instances if one.instance_type == "human"] == ["Skeleton_T"]
    assert len({one.id for one in instances}) == 350


def test_instance_maps_belong_to_their_frames_only(annotations, full_size):
    maps = [annotations.read(time) for time in CAPTURE_NS]
    assert maps[2] is None
    valid = full_size.valid
    for (one,) in maps[:2]:
        assert one.shape == (1408, 1408) and one.dtype == np.int32
        assert (one[~valid] == -1).all()
        assert (one[valid] == -1).mean() < 1e-3
        names = {annotations.instances[index].name for index in np.unique(one[one >= 0])}
        assert 85 <= len(names) <= 92 and {"ApartmentEnv", "Skeleton_T"} <= names


def test_a_segmentation_up_to_3_ms_older_or_newer_is_used(annotations):
    for time, sign in zip(ANNOTATION_NS, (-1, 1), strict=True):
        assert annotations.read(time + sign * 3_000_000) is not None
        assert annotations.read(time + sign * 3_000_001) is None


def test_without_the_people_segmentation_the_plain_one_is_read(copy, capfd):
    (copy / "segmentations_with_skeleton.vrs").unlink()
    reader, shown = first_map(copy)
    assert "reading segmentations.vrs" in capfd.readouterr().err
    present = {reader.instances[index].name for index in np.unique(shown) if index >= 0}
    assert "Skeleton_T" not in present and "ApartmentEnv" in present
    (copy / "segmentations.vrs").unlink()
    assert first_map(copy) == (None, None)


def test_an_id_that_no_instance_has_is_named(copy):
    entries = json.loads((copy / "instances.json").read_text())
    unlisted = next(key for key, entry in entries.items() if entry["instance_name"] == "ApartmentEnv")
    del entries[unlisted]
    (copy / "instances.json").write_text(json.dumps(entries))
    with pytest.raises(UserError, match=f"{unlisted} .*instances.json"):
        first_map(copy)


FIELDS = ("instance_id", "instance_name", "category", "motion_type", "instance_type")
ENTRY = dict(zip(FIELDS, (7, "a", "b", "static", "object"), strict=True))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "JSON"),
        ("[]", "no instances"),
        (json.dumps({"7": {key: ENTRY[key] for key in ENTRY if key != "category"}}), "instance 7 lacks"),
        (json.dumps({"7": ENTRY | {"motion_type": "moving"}}), "motion_type is 'moving'"),
        (json.dumps({"7": ENTRY | {"instance_id": "seven"}}), "instance 7: instance_id"),
        (json.dumps({"7": ENTRY, "8": ENTRY}), "instance_id 7 occurs twice"),
    ],
)
def test_bad_instance_files_are_named(copy, content, message):
    (copy / "instances.json").write_text(content)
    with pytest.raises(UserError, match=f"instances.json: .*{message}"):
        first_map(copy)


def test_a_missing_truncated_or_damaged_annotation_file_is_named(copy):
    segmentation = copy / "segmentations_with_skeleton.vrs"
    write_inverted(segmentation, 60_000, 60_200)
    with pytest.raises(UserError, match=segmentation.name):
        first_map(copy)
    segmentation.write_bytes(segmentation.read_bytes()[:100_000])
    with pytest.raises(UserError, match=segmentation.name):
        open_annotations(copy, AnnotationKeys(pinhole(352)))
    (copy / "instances.json").unlink()
    with pytest.raises(UserError, match="instances.json"):
        first_map(copy)


def test_important_native_messages_are_kept_and_the_descriptors_restored(capfd):
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    with pytest.raises(RuntimeError), captured_log() as messages:
        os.write(2, b"\x1b[38;2;000;000;255m[VrsDataProvider][INFO]: activated\x1b[0m\n\x1b[0m")
        os.write(2, b"\x1b[38;2;255;000;000m[Reader][ERROR]: Cannot read.\x1b[0m\n")
        os.write(1, b"WARNING: Invalid device version, vrs tag\nCorrupt JPEG data\n")
        raise RuntimeError
    assert sorted(messages) == ["Corrupt JPEG data", "[Reader][ERROR]: Cannot read."]
    os.write(2, b"after\n")
    assert capfd.readouterr() == ("", "after\n")
    assert before is None or len(os.listdir("/proc/self/fd")) == before
