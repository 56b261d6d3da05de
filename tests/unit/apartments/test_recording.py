"""A whole recording: motion, static objects, and frames that are rendered at the same time."""

import json
import threading
import time

import numpy as np
import pytest

from egosplat_apartments.adt_format.adt import write_documents
from egosplat_apartments.adt_format.aria import DEVICE_SERIAL
from egosplat_apartments.stage import in_order, make_sequence, threads

TINY = {"name": "tiny", "seed": 8, "size": 64, "fps": 1.5, "seconds": 4.0, "objects": 16}


@pytest.fixture(scope="module")
def still():
    sequence = make_sequence(**TINY, motion=0.0)
    return sequence, list(sequence.frames())


def test_without_motion_the_scene_is_static_and_empty(still):
    sequence, frames = still
    assert all(one.instance_type == "object" for one in sequence.instances)
    for frame in frames:
        assert frame.skeletons == {}
        assert np.array_equal(frame.with_people.segmentation, frame.without_people.segmentation)
        for uid, pose in frame.world_from_object.items():
            assert np.array_equal(pose, frames[0].world_from_object[uid])
    assert frames[0].world_from_object


def test_frames_have_the_configured_number_and_rate(recorded):
    sequence, frames = recorded.sequence, recorded.frames
    assert len(frames) == sequence.frame_count == 40
    captures = np.array([frame.capture_ns for frame in frames])
    assert np.allclose(np.diff(captures), 1e9 / sequence.fps, atol=1)
    assert sequence.start_ns < captures[0] and captures[-1] < sequence.end_ns
    objects = [one for one in sequence.instances if one.instance_type == "object"]
    known = {one.instance_id for one in sequence.instances}
    static, dynamic = (
        {one.instance_id for one in objects if one.motion_type == motion} for motion in ("static", "dynamic")
    )
    assert set(sequence.world_from_static) == static
    for frame in frames:
        assert set(frame.world_from_object) == dynamic
        for view in (frame.with_people, frame.without_people):
            seen = set(np.unique(view.segmentation).tolist()) - {0}
            assert seen <= known and seen == set(view.visibility)
            assert all(0 <= share <= 1 for share in view.visibility.values())
        assert 0.001 < frame.exposure_s < 0.02 and frame.gain > 0
    gains = [frame.gain for frame in frames]
    assert 0.01 < np.ptp(gains) / np.mean(gains) < 0.2


def test_people_are_visible_only_in_the_view_with_people(recorded):
    people = [one.instance_id for one in recorded.sequence.instances if one.category == "person"]
    assert len(people) == 2
    for person in people:
        pixels = [(frame.with_people.segmentation == person).mean() for frame in recorded.frames]
        assert max(pixels) > 0.01
        assert min(pixels) < 0.001
    for frame in recorded.frames:
        assert not np.isin(frame.without_people.segmentation, people).any()
        nearer = frame.with_people.depth_mm.astype(int) - frame.without_people.depth_mm
        assert (nearer <= 0).all()
        assert (nearer[frame.with_people.segmentation == frame.without_people.segmentation] == 0).all()


def test_carried_objects_end_elsewhere_and_others_stay(recorded):
    world = recorded.world
    ids = [one.instance_id for one in world.apartment.instances[1:]]
    first, last = world.thing_poses(-1.0), world.thing_poses(30.0)
    targets = {ids[job.errand.thing.number]: job.errand for person in world.people for job in person.jobs}
    assert 2 <= len(targets) < len(first)
    for uid in first:
        path = [frame.world_from_object[uid] for frame in recorded.frames]
        moved = np.linalg.norm(last[uid][:3, 3] - first[uid][:3, 3])
        if uid in targets:
            assert moved > 0.25 and np.array_equal(last[uid], targets[uid].target)
            steps = np.linalg.norm(np.diff([pose[:3, 3] for pose in path], axis=0), axis=1)
            assert steps.max() < 1.6 / recorded.sequence.fps * 1.5
            # It ends on another piece of furniture.
            assert targets[uid].support != targets[uid].thing.support
            surface = max(s.height for s in world.apartment.things[targets[uid].support].model.surfaces)
            assert last[uid][1, 3] <= surface + 0.01
        else:
            assert all(np.array_equal(pose, first[uid]) for pose in path)


def test_skeletons_belong_to_the_people(recorded):
    people = {one.instance_id for one in recorded.sequence.instances if one.instance_type == "human"}
    joints = {uid: np.array([frame.skeletons[uid] for frame in recorded.frames]) for uid in people}
    for person in recorded.world.people:
        track = joints[person.instance.instance_id]
        assert track.shape[1:] == (20, 3) and np.isfinite(track).all()
        assert track[..., 1].min() > -0.05 and track[..., 1].max() < 1.9
        # Bones keep their lengths.
        for a, b, length in ((4, 5, 0.29), (5, 6, 0.26), (12, 13, 0.43), (13, 14, 0.42)):
            assert np.allclose(np.linalg.norm(track[:, a] - track[:, b], axis=1), length, atol=1e-6)
    places = [joints[uid][:, 0][:, [0, 2]] for uid in people]
    assert np.linalg.norm(places[0] - places[1], axis=1).min() > 0.3


def test_the_device_is_associated_with_the_wearer(recorded, still, tmp_path):
    for sequence, expected in ((recorded.sequence, 1), (still[0], 0)):
        write_documents(tmp_path, sequence)
        people = json.loads((tmp_path / "skeleton_aria_association.json").read_text())["SkeletonMetadata"]
        assert sum(person["AssociatedDeviceSerial"] == DEVICE_SERIAL for person in people) == expected


def test_results_come_in_order_and_are_computed_at_the_same_time_and_few_wait(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert threads() == 2
    second = threading.Event()

    def double(item: int) -> int:
        if item == 0:
            assert second.wait(10)
        second.set()
        return 2 * item

    assert list(in_order(double, range(7))) == [0, 2, 4, 6, 8, 10, 12]
    begun: list[int] = []
    results = in_order(begun.append, range(100))
    next(results)
    time.sleep(0.05)
    results.close()
    assert len(begun) <= 3
    monkeypatch.setenv("OMP_NUM_THREADS", "0")
    assert threads() == 1
