"""The annotations of a real Aria Digital Twin recording: two of its three frames are annotated."""

import json

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.frames.adt import open_recording
from egosplat.frames.annotations_stage import open_annotations
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.frames.rectify import pinhole

OPTIONS = FramesOptions(resolution=352, focal=460.0, upright=True)
CAPTURE_NS = [87551170813262, 87551204152300, 87551237472175]
ANNOTATION_NS = [87551170910000, 87551204237999]


@pytest.fixture(scope="module")
def full_size(sample):
    return open_recording(sample, OPTIONS.change(resolution=1408))


@pytest.fixture(scope="module")
def annotations(sample, full_size):
    return open_annotations("adt", sample, AnnotationKeys(full_size.camera, True))


def test_instances_are_read_with_their_categories(annotations):
    instances = annotations.instances
    assert len(instances) == 350
    assert [sum(one.motion_type == kind for one in instances) for kind in ("static", "dynamic")] == [304, 46]
    assert len({one.category for one in instances}) == 106
    assert [one.name for one in instances if one.instance_type == "human"] == ["Skeleton_T"]
    assert len({one.id for one in instances}) == 350


def test_instance_maps_belong_to_their_frames_only(annotations, full_size):
    maps = [annotations.instance_map(time) for time in CAPTURE_NS]
    assert maps[2] is None
    valid = full_size.valid
    for one in maps[:2]:
        assert one.shape == (1408, 1408) and one.dtype == np.int32
        assert (one[~valid] == -1).all()
        assert (one[valid] == -1).mean() < 1e-3
        names = {annotations.instances[index].name for index in np.unique(one[one >= 0])}
        assert 85 <= len(names) <= 92 and {"ApartmentEnv", "Skeleton_T"} <= names


@pytest.mark.parametrize(
    "frame, offset_ns, found",
    [(0, -3_000_000, True), (0, -3_000_001, False), (1, 3_000_000, True), (1, 3_000_001, False)],
)
def test_a_segmentation_up_to_3_ms_older_or_newer_is_used(annotations, frame, offset_ns, found):
    assert (annotations.instance_map(ANNOTATION_NS[frame] + offset_ns) is not None) == found


def test_without_the_people_segmentation_the_plain_one_is_read(copy, capfd):
    (copy / "segmentations_with_skeleton.vrs").unlink()
    reader = open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))
    assert "reading segmentations.vrs" in capfd.readouterr().err
    present = {
        reader.instances[index].name for index in np.unique(reader.instance_map(CAPTURE_NS[0])) if index >= 0
    }
    assert "Skeleton_T" not in present and "ApartmentEnv" in present
    (copy / "segmentations.vrs").unlink()
    assert open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0))) is None


def test_an_id_that_no_instance_has_is_named(copy):
    entries = json.loads((copy / "instances.json").read_text())
    unlisted = next(key for key, entry in entries.items() if entry["instance_name"] == "ApartmentEnv")
    del entries[unlisted]
    (copy / "instances.json").write_text(json.dumps(entries))
    reader = open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))
    with pytest.raises(UserError, match=f"{unlisted} .*instances.json"):
        reader.instance_map(CAPTURE_NS[0])


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
        open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))


def test_a_missing_or_truncated_annotation_file_is_named(copy):
    segmentation = copy / "segmentations_with_skeleton.vrs"
    segmentation.write_bytes(segmentation.read_bytes()[:100_000])
    with pytest.raises(UserError, match="segmentations_with_skeleton.vrs"):
        open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))
    (copy / "instances.json").unlink()
    with pytest.raises(UserError, match="instances.json"):
        open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))


def test_a_damaged_segmentation_is_named(copy):
    path = copy / "segmentations_with_skeleton.vrs"
    content = bytearray(path.read_bytes())
    content[60_000:60_200] = bytes(byte ^ 0xFF for byte in content[60_000:60_200])
    path.write_bytes(content)
    reader = open_annotations("adt", copy, AnnotationKeys(pinhole(352, 460.0)))
    with pytest.raises(UserError, match="segmentations_with_skeleton.vrs"):
        reader.instance_map(CAPTURE_NS[0])
