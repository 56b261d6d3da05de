"""The wearer's head moves smoothly through free space and looks around."""

import numpy as np
import pytest

from egosplat.geometry import invert, is_rigid, rotation_angle
from egosplat_apartments.adt_format.aria import device_from_camera

STEP_S = 1e-3


def sample(sequence, step_s):
    times = np.arange(sequence.start_ns, sequence.end_ns, round(step_s * 1e9), dtype=np.int64)
    return times, sequence.device_pose(times)


def test_poses_are_rigid_at_any_nanosecond(recorded):
    times, poses = sample(recorded.sequence, 0.01)
    assert times[0] > 10**13 and poses.dtype == np.float64 and is_rigid(poses, 1e-9).all()
    # Times keep nanosecond resolution: 1 us gives a thousandth of the motion of 1 ms.
    t = times[500]
    places = recorded.sequence.device_pose(np.array([t, t + 1000, t + 1_000_000]))[:, :3, 3]
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / [1e-6, 999e-6]
    assert speed[0] == pytest.approx(speed[1], rel=0.02)


def test_accelerations_are_bounded_and_without_jumps(recorded):
    _, poses = sample(recorded.sequence, STEP_S)
    places = poses[:, :3, 3]
    acceleration = np.diff(places, 2, axis=0) / STEP_S**2
    assert np.linalg.norm(acceleration, axis=1).max() < 6.0
    assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 0.15
    turns = np.swapaxes(poses[:-1, :3, :3], -1, -2) @ poses[1:, :3, :3]
    spin = np.stack([turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0]], -1) / (2 * STEP_S)
    assert np.abs(spin).max() < 2.5
    spin_up = np.diff(spin, axis=0) / STEP_S
    assert np.abs(spin_up).max() < 12.0
    assert np.abs(np.diff(spin_up, axis=0)).max() < 0.5


def test_images_overlap_and_the_camera_has_parallax(recorded):
    _, poses = sample(recorded.sequence, 0.1)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 0.2 and steps.sum() > 4.0
    assert np.degrees(rotation_angle(invert(poses[:-1]) @ poses[1:])).max() < 15
    forward = (poses[:, :3, :3] @ device_from_camera()[:3, :3])[:, :, 2]
    yaw = np.unwrap(np.arctan2(forward[:, 0], forward[:, 2]))
    assert np.ptp(yaw) > np.radians(120)
    assert forward[:, 1].min() < -0.4 and forward[:, 1].max() < 0.5


def test_stays_in_the_room_clear_of_furniture(recorded):
    _, poses = sample(recorded.sequence, 0.2)
    cameras = poses @ device_from_camera()
    room = recorded.world.apartment.room
    places = cameras[:, :3, 3]
    assert (np.abs(places[:, [0, 2]]) < [room.width / 2 - 0.15, room.depth / 2 - 0.15]).all()
    assert (places[:, 1] > 0.7).all() and (places[:, 1] < 1.8).all()
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(400, 3)).astype(np.float32)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    clear = [recorded.renderer.static.cast(place.astype(np.float32), ways).distance.min() for place in places]
    assert min(clear) > 0.12
