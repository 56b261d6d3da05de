"""Which frames are compared, and when a scene is static."""

import numpy as np
import pytest

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.survey.moving import Motion, choose_pairs, is_static, measure_motion

SECOND = 1_000_000_000


def pairs_of(times_s: list[float], registered: list[bool] | None = None) -> list[list[int]]:
    times = (np.array(times_s, float) * SECOND).astype(np.int64)
    known = np.ones(len(times_s), bool) if registered is None else np.array(registered)
    return choose_pairs(times, known).tolist()


def test_frames_of_a_pair_are_a_fifth_of_a_second_apart():
    assert pairs_of([0, 0.2, 0.4]) == [[0, 1], [1, 2]]
    assert pairs_of(list(np.arange(9) / 30)) == [[0, 6], [1, 7], [2, 8]]
    assert pairs_of([0, 0.5, 1.0]) == [[0, 1], [1, 2]]


def test_frames_too_far_apart_or_without_a_pose_are_no_pair():
    assert pairs_of([0, 5.0, 5.2]) == [[1, 2]]
    assert pairs_of([0, 0.2, 0.4], [True, False, True]) == [[0, 2]]
    assert pairs_of([0, 0.2], [True, False]) == pairs_of([0]) == pairs_of([]) == []


def test_pairs_of_a_long_recording_are_spread_in_time():
    found = np.array(pairs_of(list(np.arange(3000) / 30)))
    assert len(found) == 120 and found[0, 0] < 20 and found[-1, 0] > 2960
    assert np.ptp(np.diff(found[:, 0])) <= 1


def motion(moving: list[float], measured: list[float]) -> Motion:
    return Motion(np.zeros((len(moving), 2), np.int64), np.array(moving), np.array(measured))


@pytest.mark.parametrize(
    "found, static",
    [
        (motion([0.0, 0.0], [0.7, 0.7]), True),
        (motion([0.0009, 0.0], [0.7, 0.7]), True),
        (motion([0.0011, 0.0], [0.7, 0.7]), False),
        (motion([0.0, 0.0], [0.1, 0.1]), False),  # too little is measured to say
        (motion([0.0], [0.7]), False),
        (motion([], []), False),
    ],
)
def test_a_scene_is_static_only_if_enough_is_measured(found, static):
    assert is_static(found, 0.0005) is static


def test_the_threshold_decides_whether_a_scene_is_static():
    assert is_static(motion([0.02, 0.02], [0.7, 0.7]), 1.0)
    assert not is_static(motion([0.0, 0.0], [0.7, 0.7]), 0.0)


@pytest.mark.parametrize("step, moves", [(0.0, False), (0.05, True)])
def test_the_pictures_of_a_recording(room, scene, step, moves):
    walks = [room.pose(x=0.08 * frame, yaw=3.0 * frame) for frame in range(5)]
    folder = scene(walks, [room.picture(walk, (0.2, -0.4 + step * k)) for k, walk in enumerate(walks)])
    found = measure_motion(
        open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "poses.zarr", POSES)
    )
    assert found.pairs.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert found.measured.min() > 0.3 and (found.share > 0.005 if moves else found.share == 0)
