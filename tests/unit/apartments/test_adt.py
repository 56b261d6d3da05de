"""projectaria-tools' own ADT and MPS readers read back what is written in a sequence folder."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from projectaria_tools.core import mps
from projectaria_tools.core.stream_id import StreamId
from projectaria_tools.projects.adt import (
    AriaDigitalTwinDataPathsProvider,
    AriaDigitalTwinDataProvider,
    InstanceType,
    MotionType,
    RigidityType,
    get_interpolated_aria_3d_pose_at_timestamp_ns,
)
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.geometry import interpolate_poses, invert, make_pose, rotation_angle
from egosplat_apartments.adt_format.adt import ground_truth_ns, trajectory_table, write_sequence
from egosplat_apartments.adt_format.adt_truth import bounding_boxes
from egosplat_apartments.adt_format.aria import camera_calibration
from egosplat_apartments.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Instance, Sequence, View

RGB = StreamId("214-1")
SIZE, COUNT = 64, 4
START_NS = 87_551_170_813_262
ROOM, SHELF, CUP, PERSON = 4_377_907_428_960_199, 1_002, 6_243_788_802_362_822, 6_810_803_442_292_599
BOUNDS = np.array([[-4.0, 0, -3], [4, 2.5, 3]])
INSTANCES = [
    Instance(ROOM, "Room_1", "Room", "shelter", 1, "static", "object", BOUNDS),
    Instance(SHELF, "Shelf_1", "Shelf", "shelf", 2, "static", "object", 0.5 * BOUNDS),
    Instance(CUP, "Cup_1", "Cup", "cup", 3, "dynamic", "object", 0.01 * BOUNDS),
    Instance(PERSON, "Skeleton_T", "Skeleton", "person", 4, "dynamic", "human", 0.8 * BOUNDS),
]
LOG_OF_ANY_SEQUENCE = re.compile(
    # The provider prints these also for real ADT recordings without the optional parts.
    r"stream id (400|345)-1 not found in Aria Device Model|no synthetic video data found"
    r"|Hand tracking folder|Failed to parse eye gaze vergence file"
)


def device_pose(times_ns):
    t = (np.asarray(times_ns, dtype=np.int64) - START_NS) * 1e-9
    turning = np.stack([0.6 * np.sin(4 * t), np.cos(3 * t), 0.3 * np.sin(6 * t + 1)], axis=-1)
    place = np.stack([np.sin(2 * t), 1.6 + 0.02 * np.cos(9 * t), 0.7 * t], axis=-1)
    return make_pose(Rotation.from_rotvec(turning).as_matrix(), place)


def random_pose(rng):
    return make_pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


def assert_same_pose(pose, time_ns):
    difference = invert(device_pose([time_ns])) @ pose
    assert np.linalg.norm(difference[0, :3, 3]) < 1e-6 and rotation_angle(difference)[0] < 1e-6


def make_view(rng, ids):
    segmentation = np.zeros((SIZE, SIZE), np.uint64)
    segmentation[5:50, 9:60] = rng.choice(np.array(ids, np.uint64), (45, 51))
    depth = rng.integers(0, 2**16, (SIZE, SIZE)).astype(np.uint16)
    return View(segmentation, depth, {uid: float(rng.uniform()) for uid in ids})


def make_frame(number):
    rng = np.random.default_rng(number)
    ramp, colors = np.linspace(0, 127, SIZE), rng.uniform(0, 1, (2, 3))
    picture = ramp[:, None, None] * colors[0] + ramp[None, :, None] * colors[1]
    seen = [ROOM, SHELF, CUP]
    return Frame(
        # The real sample's rate, whose captures are not on the microsecond grid.
        capture_ns=START_NS + number * 33_329_457,
        exposure_s=0.004 + 0.001 * number,
        gain=2.0 + number,
        rgb=picture.astype(np.uint8),
        with_people=make_view(rng, [*seen, PERSON]),
        without_people=make_view(rng, seen),
        world_from_object={CUP: random_pose(rng)},
        skeletons={PERSON: rng.normal(size=(51, 3))},
    )


FRAMES = [make_frame(number) for number in range(COUNT)]


def make_sequence(frames=None, **changes):
    rng = np.random.default_rng(99)
    sequence = Sequence(
        name="tiny",
        size=SIZE,
        fps=30.0,
        instances=INSTANCES,
        world_from_static={ROOM: np.eye(4), SHELF: random_pose(rng)},
        device_pose=device_pose,
        start_ns=START_NS - 10_000_123,
        end_ns=START_NS + 150_000_456,
        points=rng.normal(size=(50, 3)) * 3,
        inv_dist_std=rng.uniform(0, 0.002, 50),
        dist_std=rng.uniform(0, 0.3, 50),
        frames=frames or (lambda: iter(FRAMES)),
        frame_count=COUNT,
    )
    return replace(sequence, **changes)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("adt") / "tiny"
    write_sequence(make_sequence(), path)
    return path


def open_provider(folder, people):
    return AriaDigitalTwinDataProvider(AriaDigitalTwinDataPathsProvider(str(folder)).get_datapaths(people))


@pytest.fixture(scope="module", params=[False, True], ids=["without people", "with people"])
def people(request):
    return request.param


@pytest.fixture(scope="module")
def provider(folder, people):
    return open_provider(folder, people)


def test_official_reader_accepts_the_synthetic_sequence(folder, people, capfd):
    provider = open_provider(folder, people)
    for capture_ns in provider.get_aria_device_capture_timestamps_ns(RGB):
        provider.get_segmentation_image_by_timestamp_ns(capture_ns, RGB)
        provider.get_object_3d_boundingboxes_by_timestamp_ns(capture_ns)
        provider.get_aria_3d_pose_by_timestamp_ns(capture_ns)
    log = "".join(capfd.readouterr())
    assert "214-1/camera-rgb activated" in log
    bad = re.findall(r"(?im)^.*(?:warning|error|fail|invalid).*$", re.sub(r"\x1b\[[0-9;]*m", "", log))
    assert [line for line in bad if not LOG_OF_ANY_SEQUENCE.search(line)] == []


def test_the_folder_is_complete(folder, provider):
    has = [name for name in dir(provider) if name.startswith("has_") and name != "has_instance_id"]
    assert len(has) > 5
    assert [name for name in has if not getattr(provider, name)()] == ["has_synthetic_images"]
    paths = AriaDigitalTwinDataPathsProvider(str(folder))
    assert paths.get_num_skeletons() == 1 and not paths.is_multi_person()
    assert paths.get_device_serial_number() == "SYNTHETIC"
    camera = provider.get_aria_camera_calibration(RGB)
    assert camera.get_image_size().tolist() == [SIZE, SIZE]
    assert camera.get_valid_radius() == camera_calibration(SIZE).get_valid_radius()
    assert provider.get_eyegaze_by_timestamp_ns(FRAMES[1].capture_ns).data().yaw == 0.0


def test_what_is_written_of_each_frame_is_read_back(provider, people):
    captures = provider.get_aria_device_capture_timestamps_ns(RGB)
    assert captures == [frame.capture_ns for frame in FRAMES]
    for number, frame in enumerate(FRAMES):
        found = provider.get_aria_image_by_timestamp_ns(frame.capture_ns, RGB)
        assert found.dt_ns() == 0
        error = np.abs(found.data().to_numpy_array().astype(int) - frame.rgb)
        assert error.max() <= 16 and error.mean() < 2
        record = provider.raw_data_provider_ptr().get_image_data_by_index(RGB, number)[1]
        assert (record.exposure_duration, record.gain) == (frame.exposure_s, frame.gain)
        view = frame.with_people if people else frame.without_people
        labels = provider.get_segmentation_image_by_timestamp_ns(frame.capture_ns, RGB)
        depth = provider.get_depth_image_by_timestamp_ns(frame.capture_ns, RGB)
        skeleton = provider.get_skeleton_by_timestamp_ns(frame.capture_ns, PERSON)
        late = ground_truth_ns(frame.capture_ns) - frame.capture_ns
        assert all(truth.is_valid() and truth.dt_ns() == late for truth in (labels, depth, skeleton))
        assert labels.data().to_numpy_array().dtype == np.uint64
        np.testing.assert_array_equal(labels.data().to_numpy_array(), view.segmentation)
        np.testing.assert_array_equal(depth.data().to_numpy_array(), view.depth_mm)
        np.testing.assert_allclose(skeleton.data().joints, frame.skeletons[PERSON], rtol=0, atol=1e-12)


def test_instances_are_read_with_their_categories(provider):
    assert sorted(provider.get_instance_ids()) == sorted(one.instance_id for one in INSTANCES)
    assert provider.get_skeleton_ids() == [PERSON]
    for one in INSTANCES:
        found, human = provider.get_instance_info_by_id(one.instance_id), one.instance_type == "human"
        names = ("name", "category", "category_uid")
        assert [getattr(found, name) for name in names] == [getattr(one, name) for name in names]
        assert (found.id, found.prototype_name) == (one.instance_id, one.prototype)
        assert found.motion_type == getattr(MotionType, one.motion_type.upper())
        assert found.instance_type == getattr(InstanceType, one.instance_type.upper())
        assert found.rigidity_type == (RigidityType.DEFORMABLE if human else RigidityType.RIGID)


def test_poses_and_boxes_of_objects_are_read_back(provider, people):
    static = make_sequence().world_from_static
    for frame in FRAMES:
        found = provider.get_object_3d_boundingboxes_by_timestamp_ns(frame.capture_ns)
        assert found.dt_ns() == ground_truth_ns(frame.capture_ns) - frame.capture_ns
        assert set(found.data()) == {ROOM, SHELF, CUP}
        for uid, pose in {**static, **frame.world_from_object}.items():
            box = found.data()[uid]
            np.testing.assert_allclose(box.transform_scene_object.to_matrix(), pose, rtol=0, atol=1e-12)
            bounds = next(one.bounds for one in INSTANCES if one.instance_id == uid)
            assert box.aabb.tolist() == bounds.T.ravel().tolist()  # xmin, xmax, ymin, ...
        # In the picture, boxes surround the pixels of their object.
        view = frame.with_people if people else frame.without_people
        boxes = provider.get_object_2d_boundingboxes_by_timestamp_ns(frame.capture_ns, RGB).data()
        boxes |= provider.get_skeleton_2d_boundingboxes_by_timestamp_ns(frame.capture_ns, RGB).data()
        assert set(boxes) == {ROOM, SHELF, CUP} | ({PERSON} if people else set())
        for uid, box in boxes.items():
            rows, columns = np.nonzero(view.segmentation == uid)
            assert box.box_range.tolist() == [columns.min(), columns.max(), rows.min(), rows.max()]
            assert box.visibility_ratio == pytest.approx(view.visibility[uid], rel=1e-6)


def test_the_ground_truth_trajectory_is_the_motion_of_the_device(provider):
    sequence = make_sequence()
    assert 0 <= provider.get_start_time_ns() - sequence.start_ns < 1000
    assert 0 <= sequence.end_ns - provider.get_end_time_ns() < 1000
    for frame in FRAMES:
        middle_ns = frame.capture_ns + ROLLING_SHUTTER_MIDDLE_NS
        for time_ns in (ground_truth_ns(frame.capture_ns), middle_ns):
            found = get_interpolated_aria_3d_pose_at_timestamp_ns(provider, time_ns).data()
            assert_same_pose(found.transform_scene_device.to_matrix(), time_ns)
        exact = provider.get_aria_3d_pose_by_timestamp_ns(ground_truth_ns(frame.capture_ns))
        assert exact.dt_ns() == 0
        assert exact.data().gravity_world.tolist() == [0.0, -9.81, 0.0]


def test_the_mps_trajectory_is_the_motion_of_the_device_and_points_are_read_back(folder):
    rows = mps.read_closed_loop_trajectory(str(folder / "mps/slam/closed_loop_trajectory.csv"))
    times_ns = np.array([round(row.tracking_timestamp.total_seconds() * 1e6) for row in rows]) * 1000
    assert 0 < np.diff(times_ns).min() and np.diff(times_ns).max() == 1_000_000
    poses = np.stack([row.transform_world_device.to_matrix() for row in rows])
    np.testing.assert_allclose(poses, device_pose(times_ns), rtol=0, atol=1e-12)
    for frame in FRAMES:
        middle_ns = frame.capture_ns + ROLLING_SHUTTER_MIDDLE_NS
        assert_same_pose(interpolate_poses(times_ns, poses, np.array([middle_ns]))[0], middle_ns)
        # Some readers take the nearest row instead.
        assert_same_pose(poses[np.abs(times_ns - middle_ns).argmin()], middle_ns)
    sequence = make_sequence()
    points = mps.read_global_point_cloud(str(folder / "mps/slam/semidense_points.csv.gz"))
    found = np.array([point.position_world for point in points])
    np.testing.assert_allclose(found, sequence.points, rtol=0, atol=1e-6)
    deviations = np.array([(point.inverse_distance_std, point.distance_std) for point in points])
    np.testing.assert_allclose(deviations.T, [sequence.inv_dist_std, sequence.dist_std], rtol=1e-5)
    assert {point.graph_uid for point in points} == {row.graph_uid for row in rows}


def test_velocities_are_in_the_device_frame():
    axis, forward = np.array([0.3, -1.2, 0.5]), np.array([0.1, 0.7, -0.4])

    def constant_motion(times_ns):
        t = (np.asarray(times_ns) - START_NS)[:, None] * 1e-9
        return make_pose(Rotation.from_rotvec(axis * t).as_matrix(), forward * t)

    times_us = np.arange(START_NS // 1000 + 1, START_NS // 1000 + 90_000, 10_000)
    table = trajectory_table(make_sequence(), times_us, constant_motion)
    angular = table[[f"angular_velocity_{name}_device" for name in "xyz"]].to_numpy()
    np.testing.assert_allclose(angular, np.tile(axis, (len(times_us), 1)), rtol=0, atol=1e-6)
    rotation = constant_motion(times_us * 1000)[:, :3, :3]
    linear = table[[f"device_linear_velocity_{name}_device" for name in "xyz"]].to_numpy()
    np.testing.assert_allclose(np.einsum("nij,nj->ni", rotation, linear), [forward] * len(linear), atol=2e-3)


def test_the_same_sequence_gives_the_same_bytes(folder, tmp_path):
    write_sequence(make_sequence(), tmp_path / "tiny")
    written = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert written == {path.relative_to(tmp_path / "tiny") for path in tmp_path.rglob("*") if path.is_file()}
    for name in written:
        assert (folder / name).read_bytes() == (tmp_path / "tiny" / name).read_bytes(), name
    archive = (folder / "mps/slam/semidense_points.csv.gz").read_bytes()
    assert archive[4:8] == bytes(4)  # no timestamp


def test_without_people(tmp_path):
    frames = [replace(frame, with_people=frame.without_people, skeletons={}) for frame in FRAMES]
    write_sequence(make_sequence(lambda: iter(frames), instances=INSTANCES[:3]), tmp_path / "tiny")
    assert AriaDigitalTwinDataPathsProvider(str(tmp_path / "tiny")).get_num_skeletons() == 0
    provider = open_provider(tmp_path / "tiny", people=False)
    assert provider.get_skeleton_ids() == []
    assert provider.get_segmentation_image_by_timestamp_ns(START_NS, RGB).is_valid()
    assert (tmp_path / "tiny" / "segmentations_with_skeleton.vrs").is_file()


DEPTH = np.zeros((SIZE, SIZE), np.uint16)


def dying_frames():
    yield make_frame(0)
    raise RuntimeError("the renderer died")


def first_with(**changes):
    return lambda: iter([replace(make_frame(0), **changes)])


@pytest.mark.parametrize(
    ("frames", "error"),
    [
        (dying_frames, "the renderer died"),
        (first_with(), "1 frames, not 4"),
        (lambda: map(make_frame, [1, 0, 2, 3]), "frame 1 was captured"),
        (first_with(with_people=View(np.full((SIZE, SIZE), 77, np.uint64), DEPTH, {})), "id 77"),
        (first_with(rgb=np.zeros((SIZE, SIZE, 3), np.float32)), "rgb: float32"),
        (first_with(world_from_object={}), f"world_from_object: missing \\[{CUP}\\]"),
        ({"end_ns": START_NS + 100_000_000}, "trajectory does not cover"),
        ({"world_from_static": {ROOM: np.eye(4)}}, f"missing \\[{SHELF}\\]"),
    ],
)
def test_a_failed_write_leaves_nothing(tmp_path, frames, error):
    sequence = make_sequence(**frames) if isinstance(frames, dict) else make_sequence(frames)
    with pytest.raises((RuntimeError, ValueError), match=error):
        write_sequence(sequence, tmp_path / "tiny")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_not_changed(tmp_path):
    (tmp_path / "tiny/precious").mkdir(parents=True)
    with pytest.raises(UserError, match="exists already"):
        write_sequence(make_sequence(), tmp_path / "tiny")
    assert [path.name for path in tmp_path.rglob("*")] == ["tiny", "precious"]


def test_file_names_equal_those_of_the_real_recording(folder, real_data):
    real = real_data("adt_sample")
    tables = {path: folder / path.name for path in real.glob("*.csv")}
    assert len(tables) >= 6
    pairs = [*tables.items(), (real / "aria_trajectory.csv", folder / "mps/slam/closed_loop_trajectory.csv")]
    for theirs, ours in pairs:
        assert pd.read_csv(ours, nrows=0).columns.equals(pd.read_csv(theirs, nrows=0).columns), theirs.name
    for name, added in (("metadata.json", {"origin"}), ("Skeleton_T.json", set()), ("instances.json", set())):
        ours, theirs = (json.loads((path / name).read_text()) for path in (folder, real))
        if name == "instances.json":
            ours, theirs = ours[str(PERSON)], theirs[str(PERSON)]
        assert set(ours) == set(theirs) | added, name
    names = [{path.name for path in root.glob("*.*")} for root in (real, folder)]
    assert names[0] - names[1] == {"synthetic_video.vrs"}


def test_bounding_boxes_are_those_of_the_real_recording(real_data):
    provider = open_provider(real_data("adt_sample"), people=True)
    ids = np.array(sorted(provider.get_instance_ids()), dtype=np.uint64)
    time_ns = provider.get_aria_device_capture_timestamps_ns(RGB)[1]
    segmentation = provider.get_segmentation_image_by_timestamp_ns(time_ns, RGB).data().to_numpy_array()
    theirs = provider.get_object_2d_boundingboxes_by_timestamp_ns(time_ns, RGB).data()
    theirs |= provider.get_skeleton_2d_boundingboxes_by_timestamp_ns(time_ns, RGB).data()
    expected = {uid: tuple(box.box_range.tolist()) for uid, box in theirs.items()}
    assert bounding_boxes(segmentation, ids) == expected
