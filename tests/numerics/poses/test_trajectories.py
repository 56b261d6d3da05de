"""Trajectories: few or unsorted rows, quaternions of either sign, rotations of any angle, gaps and far origins."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.geometry import interpolate_poses, invert, is_rigid, make_pose, rotation_angle, transform
from egosplat.poses.trajectory import interpolate_trajectory, read_trajectory
from tests.unit.poses.conftest import trajectory_table

EPOCH = 1_700_000_000_000_000_000
"""Nanoseconds since 1970, too many for a float64."""

AXIS = np.array([0.48, -0.6, 0.64])


def poses(angles: list[float], places: np.ndarray | None = None) -> np.ndarray:
    """(N, 4, 4) poses rotated about one axis by angles [rad]."""
    turns = Rotation.from_rotvec(np.outer(angles, AXIS)).as_matrix()
    return make_pose(turns, np.zeros((len(angles), 3)) if places is None else places)


@pytest.fixture
def write(tmp_path):
    """``write(times_us, quaternions, places)``: a trajectory table, quaternions xyzw."""

    def make(times_us: list[float], quaternions: np.ndarray, places: np.ndarray | None = None) -> Path:
        places = np.zeros((len(times_us), 3)) if places is None else places
        trajectory_table(times_us, quaternions, places).to_csv(tmp_path / "trajectory.csv", index=False)
        return tmp_path / "trajectory.csv"

    return make


@pytest.mark.numerics(
    "positions up to 1e6 m, rows 1 ns to 1 hour apart, against exact fractions",
    within=1e-14,
    outside="before first and after last row: no pose",
)
@given(gap=st.integers(2, 3_600_000_000_000), share=st.floats(0, 1), exponent=st.floats(-3, 6))
def test_positions(measured, gap, share, exponent):
    places = np.array([[0.1, -0.7, 0.3], [0.4, 0.2, -0.9]]) * 10.0**exponent
    after = min(int(share * gap), gap)
    times = np.array([EPOCH, EPOCH + gap])
    found = interpolate_poses(times, poses([0, 1], places), np.array([EPOCH + after]))
    part = Fraction(after, gap)
    exact = [float((1 - part) * Fraction(a) + part * Fraction(b)) for a, b in places.T]
    measured(np.linalg.norm(found[0, :3, 3] - exact) / np.linalg.norm(places))


@pytest.mark.numerics(
    "rotation between two rows of 1e-9 rad to just below 180°", within=1e-12, outside="180°: either direction"
)
@given(
    angle=st.one_of(st.floats(1e-9, np.pi - 1e-3), st.floats(-9, 0).map(lambda e: 10.0**e)),
    share=st.floats(0, 1),
)
def test_turns(measured, angle, share):
    after = int(share * 1_000_000)
    times = np.array([EPOCH, EPOCH + 1_000_000])
    found = interpolate_poses(times, poses([0.2, 0.2 + angle]), np.array([EPOCH + after]))
    measured(float(rotation_angle(invert(poses([0.2 + angle * after / 1_000_000])) @ found)[0]))
    half = interpolate_poses(np.array([0, 2]), poses([0.0, np.pi]), np.array([1]))
    assert is_rigid(half).all() and float(rotation_angle(half)[0]) == pytest.approx(np.pi / 2)


@pytest.mark.numerics("quaternions q and -q in all combinations over 6 rows", within=1e-14)
@given(signs=st.lists(st.sampled_from([-1.0, 1.0]), min_size=6, max_size=6))
def test_signs_of_quaternions(write, measured, signs):
    times, angles = np.arange(6) * 1000, [0.0, 0.5, 1.0, 1.2, 0.9, 0.4]
    plain = Rotation.from_rotvec(np.outer(angles, AXIS)).as_quat()
    wanted = np.arange(0, 5_000_000, 250_000)
    found, truth = (
        interpolate_trajectory(read_trajectory(write(times, rows)), wanted, 50.0)
        for rows in (plain * np.array(signs)[:, None], plain)
    )
    measured(np.abs(found - truth).max())


@pytest.mark.numerics(
    "quaternion length of 0.99 to 1.01", within=1e-14, outside="normalized; else: UserError names the line"
)
@given(length=st.floats(0.991, 1.009))
def test_lengths_of_quaternions(write, measured, length):
    rows = Rotation.from_rotvec(np.outer([0.0, 0.5], AXIS)).as_quat()
    found = read_trajectory(write([0, 1000], rows * length)).world_from_device
    measured(np.abs(found - poses([0.0, 0.5])).max())


@pytest.mark.numerics(
    "rows: quaternion length 0, 0.98, 1.02, NaN; times that repeat, decrease, are NaN; infinite position",
    outside="UserError names file and line",
)
@pytest.mark.parametrize(
    ("time", "length", "place", "words"),
    [
        *((1000, length, 0.0, "line 3 .*: the row has a quaternion") for length in (0.0, 0.98, 1.02)),
        *((time, 1.0, 0.0, "line 3 .*: the row has a tracking_timestamp_us not after") for time in (0, -5)),
        (1000, np.nan, 0.0, "line 3 .*: the row has a value"),
        (np.nan, 1.0, 0.0, "line 3 .*: the row has a value"),
        (1000, 1.0, np.inf, "line 3 .*: the row has a value"),
    ],
)
def test_impossible_rows_are_rejected(write, time, length, place, words):
    quaternions = np.array([[0, 0, 0, 1.0], [0, 0, 0, length], [0, 0, 0, 1.0]])
    places = np.array([[0, 0, 0], [place, 0, 0], [0, 0, 0.0]])
    with pytest.raises(UserError, match=words):
        read_trajectory(write([0, time, 2000], quaternions, places))


@pytest.mark.numerics("frames in any order of time", within=0.0, outside="each has its own pose")
@given(order=st.permutations(range(8)))
def test_frames_out_of_order(write, measured, order):
    rows = Rotation.from_rotvec(np.outer(np.linspace(0, 1, 5), AXIS)).as_quat()
    trajectory = read_trajectory(write(np.arange(5) * 1000, rows))
    times = np.arange(8) * 500_000
    orders = list(range(8)), list(order)
    found, shuffled = (interpolate_trajectory(trajectory, times[each], 50.0) for each in orders)
    measured(np.abs(shuffled - found[list(order)]).max())


@pytest.mark.numerics("pose times out of order, repeated; only one", outside="ValueError")
@pytest.mark.parametrize("times", [[0, 2, 1], [0, 1, 1], [0]])
def test_times_out_of_order(times):
    with pytest.raises(ValueError, match="strictly increasing"):
        interpolate_poses(np.array(times), poses([0.0] * len(times)), np.array([0]))


@pytest.mark.numerics("trajectory of two rows", within=1e-14, outside="fewer: UserError")
def test_two_rows(write, measured):
    rows = Rotation.from_rotvec(np.outer([0.0, 0.5], AXIS)).as_quat()
    trajectory = read_trajectory(write([0, 1000], rows))
    found = interpolate_trajectory(trajectory, np.array([0, 500_000, 1_000_000]), 50.0)
    measured(np.abs(found - poses([0.0, 0.25, 0.5])).max())
    for count in (0, 1):
        with pytest.raises(UserError, match=f"has {count} rows"):
            read_trajectory(write([0, 1000][:count], rows[:count]))


@pytest.mark.numerics("frame outside the trajectory, or in a long gap", outside="no pose (NaN)")
def test_frames_without_a_pose(write):
    rows = Rotation.from_rotvec(np.outer([0.0, 0.5, 0.6], AXIS)).as_quat()
    trajectory = read_trajectory(write([0, 1000, 500_000], rows))
    found = interpolate_trajectory(trajectory, np.array([-1, 250_000_000, 500_000_001]), 50.0)
    assert np.isnan(found).all()


@pytest.mark.numerics("inverse of a pose 1 to 1e12 m from the origin, and back", within=1e-14)
@given(exponent=st.floats(0, 12), angle=st.floats(0, 3))
def test_inverse(measured, exponent, angle):
    place = np.array([0.3, -0.9, 0.2]) * 10.0**exponent
    pose = poses([angle], place[None])[0]
    back = transform(pose, transform(invert(pose), place))
    measured(np.linalg.norm(back - place) / np.linalg.norm(place))


@pytest.mark.numerics("angle between rotations of 1e-12 rad to pi", within=1e-14, outside="absolute error")
@given(exponent=st.floats(-12, np.log10(np.pi)))
def test_angles(measured, exponent):
    angle = 10.0**exponent
    measured(abs(float(rotation_angle(poses([angle]))[0]) - angle))
