"""Poses and points of ADT recordings."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from projectaria_tools.core import data_provider, mps
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.geometry import CLOCKWISE, Camera, make_pose
from egosplat.poses.adt import TRAJECTORIES, adt_poses
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import Poses
from egosplat.poses.trajectory import read_trajectory
from tests.support.recordings import copy_files, opened

CAMERA = Camera(64, 48, 50.0, 50.0, 32.0, 24.0)
TURN = Rotation.from_euler("xyz", [170.0, 5.0, -10.0], degrees=True)
MOUNT = make_pose(TURN.as_matrix(), np.array([0.1, 0.0, 0.02]))


def poses_at(folder: Path, times_us: list[float], trajectory: str = "ground_truth", mount=MOUNT) -> Poses:
    times = np.array([round(time * 1000) for time in times_us], dtype=np.int64)
    return adt_poses(folder, times, mount, CAMERA, PosesOptions(trajectory=trajectory))


def cloud(inv_dist_std: list[float], dist_std: list[float]) -> pd.DataFrame:
    index = np.arange(len(dist_std))
    places = {"px_world": index * 1.0, "py_world": index * 2.0, "pz_world": 0.5}
    spread = {"inv_dist_std": inv_dist_std, "dist_std": dist_std}
    return pd.DataFrame({"uid": index, "graph_uid": "a"} | places | spread)


def test_poses_are_exact_at_rows_and_interpolated_between_them(table, recording):
    poses = poses_at(recording(table), [1_010_000, 1_015_000, 1_002_500])
    turns = Rotation.from_euler("y", [[30.0], [60.0], [7.5]], degrees=True).as_matrix()
    devices = make_pose(turns, np.array([[x, 1.5, -0.25] for x in (1.01, 1.015, 1.0025)]))
    np.testing.assert_allclose(poses.camera_to_world, devices @ MOUNT, atol=1e-12)
    assert poses.registered.all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda table: table.assign(ty_world_device=[1, 1, 1, "abc", 1]), "csv, line 5 .*missing or not a"),
        (lambda table: table.assign(graph_uid=list("abaaa")), "csv, line 3 .*another world frame"),
        (lambda table: table.drop(columns="qw_world_device"), "has no column qw_world_device"),
        (lambda table: table.assign(tx_world_device=1e300), "line 2 .*more than 1,000 km from the origin"),
        (lambda table: table.assign(gravity_y_world=0.0), "gravity_world is 0 m/s"),
    ],
)
def test_a_bad_table_is_rejected(table, recording, change, message):
    with pytest.raises(UserError, match=f"aria_trajectory.*{message}"):
        poses_at(recording(change(table)), [1_000_000])


def test_an_empty_or_binary_file_is_rejected(tmp_path):
    path = tmp_path / "aria_trajectory.csv"
    for content in (b"", b"\x00\xff\xfe\x80" * 50):
        path.write_bytes(content)
        with pytest.raises(UserError, match="aria_trajectory.csv"):
            read_trajectory(path)


@pytest.mark.parametrize("wanted", TRAJECTORIES)
def test_a_missing_trajectory_advises_the_one_that_is_present(table, recording, wanted):
    (present,) = set(TRAJECTORIES) - {wanted}
    folder = recording(table, closed_loop=present == "closed_loop")
    with pytest.raises(UserError, match=f"{TRAJECTORIES[wanted].name} .*poses.trajectory={present}"):
        poses_at(folder, [1_000_000], wanted)
    (folder / TRAJECTORIES[present]).unlink()
    with pytest.raises(UserError, match=f"{TRAJECTORIES[wanted].name} is missing: download it$"):
        poses_at(folder, [1_000_000], wanted)


def test_no_registered_frame_is_rejected_with_the_reason(table, recording):
    folder = recording(table)
    with pytest.raises(UserError, match="1.000 s to 1.130 s.* 7.000 s to 8.000 s"):
        poses_at(folder, [7e6, 8e6])
    with pytest.raises(UserError, match="50 ms apart.*poses.trajectory"):
        poses_at(folder, [1_050_000])


def test_points_are_filtered_by_both_uncertainties(table, recording):
    points = cloud([0.0005, 0.001, 0.0005, 0.002, np.nan, 0.0, 0.0], [0.1, 0.1, 0.15, 0.2, 0.1, 0.0, 0.0])
    points.loc[5, "px_world"] = np.nan
    points.loc[6, "pz_world"] = 1e300
    poses = poses_at(recording(table, points, closed_loop=True), [1_000_000], "closed_loop")
    np.testing.assert_array_equal(poses.points, [[0.0, 0.0, 0.5]])
    np.testing.assert_array_equal(poses.point_rgb, [[128, 128, 128]])


@pytest.mark.parametrize("trajectory", TRAJECTORIES)
def test_points_are_optional(table, recording, trajectory):
    for points in (None, cloud([1.0], [1.0])):
        folder = recording(table, points, trajectory == "closed_loop")
        assert poses_at(folder, [1_000_000], trajectory).points.shape == (0, 3)


def test_a_damaged_point_cloud_is_rejected(table, recording):
    rng = np.random.default_rng(0)
    points = cloud(list(rng.random(5000) * 1e-3), list(rng.random(5000)))
    path = recording(table, points) / "mps" / "slam" / "semidense_points.csv.gz"
    whole = path.read_bytes()
    for damaged in (whole[:-2000], whole[:200] + b"\x00" * 40 + whole[240:], b"not a gzip file"):
        path.write_bytes(damaged)
        with pytest.raises(UserError, match="semidense_points.csv.gz"):
            poses_at(path.parents[2], [1_000_000])
    points.drop(columns="dist_std").to_csv(path, index=False)
    with pytest.raises(UserError, match=r"semidense_points.csv.gz .*\['dist_std'\]"):
        poses_at(path.parents[2], [1_000_000])


def test_a_real_trajectory_equals_the_official_readers(real_data):
    path = real_data("adt_sample") / "aria_trajectory.csv"
    official = mps.read_closed_loop_trajectory(str(path))
    ours = read_trajectory(path)
    expected = [row.transform_world_device.to_matrix() for row in official]
    np.testing.assert_allclose(ours.world_from_device, expected, atol=1e-12)
    times = [round(row.tracking_timestamp.total_seconds() * 1e6) * 1000 for row in official]
    assert ours.timestamp_ns.tolist() == times and len(times) == 6


def test_poses_of_real_frames_are_upright_and_move_little(real_data):
    folder = real_data("adt_sample")
    provider = data_provider.create_vrs_data_provider(str(folder / "video.vrs"))
    sensor = provider.get_device_calibration().get_transform_device_sensor("camera-rgb").to_matrix()
    times = np.array([87551170813262, 87551204152300, 87551237472175], dtype=np.int64)
    poses = adt_poses(folder, times, sensor @ CLOCKWISE, CAMERA, PosesOptions(trajectory="ground_truth"))
    # The first frame was captured 97 microseconds before the ground truth begins.
    assert poses.registered.tolist() == [False, True, True]
    np.testing.assert_allclose(poses.up, [0.0, 1.0, 0.0], atol=1e-12)
    assert np.linalg.norm(np.diff(poses.camera_to_world[1:, :3, 3], axis=0)) < 0.01
    assert poses.points.shape == (0, 3)
    with pytest.raises(UserError, match="closed_loop_trajectory.csv"):
        adt_poses(folder, times, sensor, CAMERA, PosesOptions(trajectory="closed_loop"))


@pytest.mark.parametrize("trajectory", ["closed_loop", "ground_truth"])
def test_the_trajectory_and_the_points_of_the_device_are_read(recording, table, tmp_path, trajectory):
    folder = recording(table, cloud([1e-4], [0.01]), trajectory == "closed_loop")
    listed = opened("poses", "adt", folder, trajectory=trajectory)
    copied = copy_files(listed, folder, tmp_path / "copy")
    whole, alone = (poses_at(each, [1_010_000, 1_015_000], trajectory) for each in (folder, copied))
    np.testing.assert_array_equal(whole.camera_to_world, alone.camera_to_world)
    np.testing.assert_array_equal(whole.points, alone.points)
    assert len(listed) == 2 and len(whole.points) == 1


def test_colmap_reads_no_file_and_known_poses_theirs(tmp_path):
    (tmp_path / "transforms.json").write_text("{}")
    assert opened("poses", "plain", tmp_path, method="colmap") == []
    assert opened("poses", "plain", tmp_path) == [tmp_path / "transforms.json"]
    assert opened("poses", "adt", tmp_path / "nowhere") == []
