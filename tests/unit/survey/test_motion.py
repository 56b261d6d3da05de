"""Motion detection between two images of a wall and a board, and over a whole recording."""

import cv2
import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.geometry import make_pose
from egosplat.moving_regions import landing, lasting_regions, meetings
from egosplat.survey.motion import measure_motion
from egosplat.survey.pairs import Match, detect_motion
from egosplat.survey.rigid import View
from egosplat.survey.views import choose_pairs, choose_revisits
from tests.unit.survey.conftest import BOARD, CAMERA, SIZE, image, pose

SECOND = 1_000_000_000

STEPS = {
    "sideways": {"x": 0.15},
    "ahead": {"z": 0.3},
    "turning": {"yaw": 12.0, "pitch": 4.0},
    "both": {"x": 0.1, "z": 0.1, "yaw": 8.0},
    "not at all": {},
}
HERE = pose()
EVERYWHERE = np.ones((SIZE, SIZE), bool)


def between(first: np.ndarray, second: np.ndarray, there: np.ndarray, valid: np.ndarray = EVERYWHERE):
    """Motion between images from the origin and from a pose."""
    match = Match(first, second, valid, CAMERA.matrix, (HERE, there), valid)
    return detect_motion(match, View(CAMERA.matrix, there[:3, 3], 3.0, BOARD / 2), valid)


def moved(step: dict, before: tuple | None = None, after: tuple | None = None, textured: bool = True):
    """Motion between images a camera step apart, with the object at two places."""
    there = pose(**step)
    return between(image(HERE, before, textured), image(there, after, textured), there)


ERROR = {"yaw": 1.0, "pitch": 0.5, "y": 0.03}


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
def test_motion_is_told_from_motion_of_the_camera_and_from_an_error_of_its_pose(step):
    found = moved(step)
    assert found.voting > 0.4 * SIZE**2 and not found.regions.any()
    assert found.noise_px < 0.3 and found.before_px < 0.4
    rows, columns = np.nonzero(moved(step, (0.1, -0.3), (0.1, -0.25)).regions)
    # The object's corner is at (88, 56); its side is 40 pixels.
    assert len(rows) > 0.5 * 40**2
    assert (columns > 80).all() and (columns < 136).all() and (rows > 48).all() and (rows < 108).all()
    there = pose(**step)
    off = between(*(image(each, (0.1, -0.3)) for each in (HERE, there)), there @ pose(**ERROR))
    assert not off.regions.any() and 4 * off.noise_px < off.before_px


@pytest.mark.parametrize("step", ["ahead", "not at all"])
def test_an_error_of_the_pose_does_not_hide_motion(step):
    """Sideways, another depth of the object and another error of the pose would explain it as well."""
    there = pose(**STEPS[step])
    images = image(HERE, (0.1, -0.3)), image(there, (0.1, -0.25))
    assert (between(*images, there @ pose(**ERROR)).regions > 0).sum() > 0.3 * 40**2


@pytest.mark.parametrize("gain, offset", [(0.4, 0), (1.0, 60), (0.6, 90)])
def test_a_change_of_brightness_is_not_motion(gain, offset):
    there = pose(**STEPS["both"])
    second = np.clip(gain * image(there) + offset, 0, 255).astype(np.uint8)
    found = between(image(HERE), second, there)
    assert found.voting > 0.3 * second.size and not found.regions.any()


def test_untextured_frames_do_not_vote_and_blurred_ones_show_no_motion():
    found = moved(STEPS["both"], textured=False)
    assert found.voting < 0.05 * SIZE**2 and not found.regions.any() and np.isnan(found.noise_px)
    there = pose(**STEPS["both"])
    images = [cv2.GaussianBlur(image(each), (0, 0), 12) for each in (HERE, there)]
    assert not between(*images, there).regions.any()


def test_motion_outside_the_lens_circle_is_ignored():
    there = pose(**STEPS["turning"])
    circle = cv2.circle(np.zeros((SIZE, SIZE), np.uint8), (80, 80), 50, 1, -1) > 0
    images = [np.where(circle, image(each), 0).astype(np.uint8) for each in (HERE, there)]
    found = between(*images, there, circle)
    assert not found.regions.any() and 0 < found.voting < circle.sum()


@pytest.mark.parametrize("case", ["black", "white", "both black", "looks back", "nothing valid", "tiny"])
def test_what_shows_nothing_in_common_is_not_judged(case):
    seen = image(HERE)
    first, second = {
        "black": (seen, seen * 0),
        "white": (seen, seen | 255),
        "both black": (seen * 0, seen * 0),
        "tiny": (np.zeros((20, 17), np.uint8),) * 2,
    }.get(case, (seen, seen))
    there = pose(yaw=180.0 * (case == "looks back"))
    found = between(first, second, there, np.full(first.shape, case != "nothing valid"))
    assert found.voting == 0 and found.regions.shape == first.shape and not found.regions.any()
    assert np.isnan([found.noise_px, found.before_px]).all()


def pairs_of(times_s: list[float], registered: list[bool] | None = None) -> list[list[int]]:
    times = (np.array(times_s, float) * SECOND).astype(np.int64)
    return choose_pairs(times, np.array(registered or [True] * len(times), bool)).tolist()


@pytest.mark.parametrize(
    ("times_s", "registered", "pairs"),
    [
        ([0, 0.2, 0.4], None, [[0, 1], [1, 2]]),
        (np.arange(9) / 30, None, [[0, 6], [1, 7], [2, 8]]),
        ([0, 0.5, 1.0], None, [[0, 1], [1, 2]]),
        # No pair over a long gap or without a pose.
        ([0, 5.0, 5.2], None, [[1, 2]]),
        ([0, 0.2, 0.4], [True, False, True], [[0, 2]]),
        ([0, 0.2], [True, False], []),
        ([0], None, []),
        ([], [], []),
    ],
)
def test_pairs_are_a_fifth_of_a_second_apart(times_s, registered, pairs):
    assert pairs_of(times_s, registered) == pairs


def test_pairs_of_a_long_recording_are_runs_that_are_spread_in_time():
    found = np.array(pairs_of(np.arange(3000) / 30))
    assert len(found) == 120 and found[0, 0] == 0 and found[-1, 0] > 2850
    follows = np.isin(found[:, 1], found[:, 0])
    assert follows.sum() == 96  # four of the five pairs of a run


def revisits_of(positions: list[float], limit: int = 9, depth: float = 2.0) -> list[list[int]]:
    poses = make_pose(np.eye(3), np.array([[x, 0.0, 0.0] for x in positions]).reshape(-1, 3))
    times = (np.arange(len(positions)) * 0.25 * SECOND).astype(np.int64)
    return choose_revisits(poses, np.full(len(positions), depth), times, limit).tolist()


def test_revisits_are_views_that_come_again_after_a_second():
    assert revisits_of([0, 5, 10, 15, 20, 25, 0.1, 30], limit=1) == [[0, 6]]
    assert revisits_of([0, 0, 0, 0]) == revisits_of([]) == revisits_of([0, 0, 0, 0, 0], limit=0) == []
    assert revisits_of([0, 5, 10, 15, 20, 25]) == revisits_of([0] * 9, depth=np.nan) == []


def square(row: int, column: int) -> np.ndarray:
    labels = np.zeros((100, 100), np.int32)
    labels[row : row + 10, column : column + 10] = 7
    return labels


def test_regions_are_carried_along_by_flow_and_rotation_and_go_on_where_they_arrive():
    flow = np.full((100, 100, 2), (3.0, -2.0))
    turned = np.array([[1.0, 0.0, 10.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert (landing(square(20, 30), flow, turned) == square(18, 43)).all()
    assert not landing(square(20, 30), flow, np.diag([1.0, 1.0, 0.0])).any()
    assert meetings(square(20, 30), square(22, 33)) == [(7, 7)]
    assert meetings(square(20, 30), square(60, 33)) == meetings(square(20, 30), square(20, 30) * 0) == []


def test_what_moves_in_three_pairs_lasts():
    links = [((0, 1), (1, 1)), ((1, 1), (2, 4)), ((5, 1), (6, 1))]
    assert lasting_regions(links) == {(0, 1), (1, 1), (2, 4)} and lasting_regions([]) == set()


def measured(folder):
    return measure_motion(*(open_artifact(folder / f"{each.name}.zarr", each) for each in (FRAMES, POSES)))


@pytest.fixture
def turning():
    """Poses to the right that turn, and images of an object that sinks."""
    trajectory = [pose(x=0.08 * frame, yaw=3.0 * frame) for frame in range(6)]
    return trajectory, [image(each, (0.2, -0.4 + 0.05 * frame)) for frame, each in enumerate(trajectory)]


def test_without_points_motion_is_the_same_in_any_unit(turning, scene):
    trajectory, images = turning
    points = {"points/xyz": np.zeros((0, 3)), "points/rgb": np.zeros((0, 3), np.uint8)}
    found = []
    for unit in (1.0, 1e-5, 1e5):
        poses = np.stack(trajectory)
        poses[:, :3, 3] *= unit
        found.append(measured(scene(list(poses), images, notes={"scale": "arbitrary"}, **points)))
    for other in found[1:]:
        assert other.shares == pytest.approx(found[0].shares, rel=1e-2)
        np.testing.assert_allclose(other.voting, found[0].voting, rtol=1e-2)


def test_pixels_that_a_frame_leaves_out_do_not_move(turning, scene):
    """An object moves where the masks of the frames hide it, and nowhere else."""
    trajectory, images = turning
    pairs = zip(images, map(image, trajectory), strict=True)
    masked = np.stack([cv2.dilate(cv2.absdiff(*pair), np.ones((3, 3))) > 0 for pair in pairs])
    assert 0.01 < masked.mean() < 0.5
    moves, hidden = (measured(scene(trajectory, images, **own)) for own in ({}, {"masked": masked}))
    assert moves.pairs.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]]
    assert moves.shares[0] > 0.005 and hidden.shares[0] == 0
    assert 0.1 < hidden.voting.min() and hidden.voting.sum() < moves.voting.sum()
