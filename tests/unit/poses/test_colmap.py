"""COLMAP on drawn pictures whose poses are known, on bad pictures, and on real photographs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from benchmarks.colmap.alignment import trajectory_error
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.poses.colmap.database import Project
from egosplat.poses.colmap.mapping import ranges, too_few
from egosplat.poses.colmap.pairs import every_pair, sequential_pairs
from egosplat.poses.colmap.pipeline import LARGEST_ERROR_PX, SHORTEST_TRACK, colmap_poses, kept_points
from egosplat.poses.result import Poses

Pictures = list[NDArray[np.uint8]]

CAMERA = Camera(240, 180, 210.0, 210.0, 120.0, 90.0)
"""Of the drawn room."""
EVERYWHERE = np.ones((CAMERA.height, CAMERA.width), np.bool_)
GUESS = Camera(240, 180, 260.0, 260.0, 120.0, 90.0)
# TUM states the centre for pixel centres at integers.
TUM_CAMERA = Camera(640, 480, 535.4, 539.2, 320.1 + 0.5, 247.6 + 0.5)


def reconstruct(
    pictures: Pictures,
    camera: Camera = CAMERA,
    known: bool = True,
    valid: NDArray[np.bool_] | None = None,
    **options: Any,
) -> Poses:
    if valid is None:
        valid = np.ones((camera.height, camera.width), np.bool_)
    defaults: dict[str, Any] = {
        "matching": "auto",
        "overlap": 2,
        "min_registered": 0.5,
        "seed": 0,
        "threads": 2,
    }
    return colmap_poses(iter(pictures), valid, camera, known, **(defaults | options))


def noise(seed: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (*EVERYWHERE.shape, 3), dtype=np.uint8)


def lens_circle() -> NDArray[np.bool_]:
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    return (columns - 119.5) ** 2 + (rows - 89.5) ** 2 < 88.0**2


@pytest.fixture(scope="session")
def true_walk(room: Any) -> NDArray[np.float64]:
    return room.walk(10)


@pytest.fixture(scope="module")
def walked(walk_pictures: Pictures) -> Poses:
    return reconstruct(walk_pictures)


def test_the_true_trajectory_is_recovered(walked: Poses, true_walk: NDArray[np.float64]):
    assert walked.registered.all()
    error = trajectory_error(walked.camera_to_world, true_walk)
    assert error["ate_rmse_m"] < 0.005  # on a path 2 m long
    assert error["rotation_rmse_deg"] < 0.3
    assert walked.notes["reprojection_error_px"] < 0.5
    assert walked.notes["scale"] == "arbitrary"
    assert walked.camera == CAMERA


def test_points_lie_on_the_planes_in_their_colours(walked: Poses, true_walk: NDArray[np.float64]):
    error = trajectory_error(walked.camera_to_world, true_walk)
    # Moved into the first camera's axes, the estimated scene is the true one up to its scale.
    first, true_first = walked.camera_to_world[0], true_walk[0]
    local = (walked.points - first[:3, 3]) @ first[:3, :3] * error["scale"]
    world = local @ true_first[:3, :3].T + true_first[:3, 3]
    wall, floor = np.abs(world[:, 2] - 4.0), np.abs(world[:, 1] - 1.2)
    poster = np.abs(world[:, 2] - 2.6 - (world[:, 0] + 0.7) * 0.3 / 1.3)
    off = np.minimum(np.minimum(wall, floor), poster)
    assert np.median(off) < 0.02
    assert all((off == plane).sum() > 20 for plane in (wall, floor, poster))
    assert len(walked.points) > 300
    assert np.ptp(walked.point_rgb.astype(int), axis=0).min() > 100


def test_up_is_that_of_the_pictures(walked: Poses):
    up_in_cameras = walked.up @ walked.camera_to_world[:, :3, :3]
    assert (up_in_cameras[:, 1] < -0.99).all()


def test_same_seed_same_bytes_whatever_the_threads(walk_pictures: Pictures, walked: Poses):
    again = reconstruct(walk_pictures, threads=1)
    np.testing.assert_array_equal(again.camera_to_world, walked.camera_to_world)
    np.testing.assert_array_equal(again.points, walked.points)
    np.testing.assert_array_equal(again.point_rgb, walked.point_rgb)
    assert again.notes == walked.notes


def test_a_guessed_focal_length_is_refined(walk_pictures: Pictures, true_walk: NDArray[np.float64]):
    poses = reconstruct(walk_pictures, GUESS, known=False)
    assert poses.registered.all()
    assert poses.camera.fx == pytest.approx(CAMERA.fx, rel=0.01)
    assert poses.camera.fy == pytest.approx(CAMERA.fy, rel=0.01)
    assert (poses.camera.cx, poses.camera.cy) == (GUESS.cx, GUESS.cy)
    assert trajectory_error(poses.camera_to_world, true_walk)["ate_rmse_m"] < 0.01


def test_a_wrong_calibration_said_to_be_known_is_kept(walk_pictures: Pictures):
    assert reconstruct(walk_pictures, GUESS).camera == GUESS


def test_only_what_the_mask_shows_is_used(walk_pictures: Pictures, true_walk: NDArray[np.float64]):
    valid = lens_circle()
    # What is outside stands still and has more texture than the scene.
    dirt = noise(5)
    pictures = [np.where(valid[..., None], picture, dirt) for picture in walk_pictures]
    poses = reconstruct(pictures, valid=valid)
    assert poses.registered.all()
    assert trajectory_error(poses.camera_to_world, true_walk)["ate_rmse_m"] < 0.01


def test_no_feature_lies_outside_of_the_mask_or_at_its_edge(walk_pictures: Pictures, tmp_path: Path):
    valid = lens_circle()
    project = features_of([np.where(valid[..., None], walk_pictures[0], 0)], valid, tmp_path)
    with pycolmap.Database.open(project.database) as database:
        (image,) = database.read_all_images()
        x, y = np.asarray(database.read_keypoints(image.image_id))[:, :2].T
    assert len(x) > 100
    assert np.hypot(x - 120.0, y - 90.0).max() < 88.0 - 1.0


def test_the_mask_margin_applies_to_the_lens_edge_only(tmp_path: Path):
    valid = EVERYWHERE.copy()
    valid[:, 120:] = False
    project = Project(tmp_path)
    project.write_mask(EVERYWHERE)
    assert not project.mask.exists()
    project.write_mask(valid)
    mask = cv2.imread(str(project.mask), cv2.IMREAD_GRAYSCALE)
    assert (mask[:, :118] == 255).all()
    assert (mask[:, 118:] == 0).all()


@pytest.mark.parametrize("known", [True, False])
def test_a_guessed_camera_is_entered_as_a_guess(walk_pictures: Pictures, tmp_path: Path, known: bool):
    project = Project(tmp_path)
    project.write_pictures(walk_pictures[:3], GUESS)
    project.import_pictures(GUESS, known)
    with pycolmap.Database.open(project.database) as database:
        (camera,) = database.read_all_cameras()
    assert camera.has_prior_focal_length == known
    assert camera.params.tolist() == [GUESS.fx, GUESS.fy, GUESS.cx, GUESS.cy]


def test_unrelated_frames_are_left_out_and_reported(
    walk_pictures: Pictures, walked: Poses, true_walk: NDArray[np.float64]
):
    blank = np.full_like(walk_pictures[0], 90)
    poses = reconstruct([noise(1), *walk_pictures[:5], blank, *walk_pictures[5:], noise(2)])
    assert np.flatnonzero(~poses.registered).tolist() == [0, 6, 12]
    assert np.isnan(poses.camera_to_world[~poses.registered]).all()
    assert poses.notes["registered"] == 10
    assert trajectory_error(poses.camera_to_world[poses.registered], true_walk)["ate_rmse_m"] < 0.005


def test_too_small_a_model_is_rejected_with_its_size(walk_pictures: Pictures):
    with pytest.raises(UserError, match="10 of 13 .*poses.min_registered .*80%") as caught:
        reconstruct([*walk_pictures, *(noise(seed) for seed in range(3))], min_registered=0.8)
    assert "not registered, counted from 0: 10 to 12" in str(caught.value)
    assert "poses.min_registered=0.76" in str(caught.value)
    assert "overlap" not in str(caught.value), "every pair was compared"


@pytest.mark.parametrize("strategy, advised", [("exhaustive", False), ("sequential", True)])
def test_a_larger_overlap_is_advised_only_where_it_would_help(strategy, advised):
    assert ("poses.overlap" in too_few({0, 1, 2}, [], 9, 0.5, strategy)) == advised


def test_a_second_model_is_reported_with_its_frames():
    text = too_few(set(range(5)), [{5, 6, 7}, {6, 7, 8, 9, 11}], 12, 0.5, "exhaustive")
    assert "not registered, counted from 0: 5 to 11" in text
    assert "A second model holds 5 (6 to 9, 11)" in text and "poses.min_registered=0.41" in text
    assert "second model" not in too_few(set(range(5)), [], 12, 0.5, "exhaustive")


def test_the_suggested_min_registered_would_be_met():
    for held in range(1, 40):
        text = too_few(set(range(held)), [], 40, 1.0, "exhaustive")
        assert float(text.rpartition("=")[2]) * 40 <= held


def test_long_lists_of_frames_are_shortened():
    assert ranges({1, 2, 3, 7}) == "1 to 3, 7"
    assert ranges(set(range(0, 100, 2))).endswith("20, 22, ...")


@pytest.mark.parametrize("known", [True, False])
def test_a_camera_that_only_turns_is_rejected(room: Any, known: bool):
    # With this guess COLMAP makes models of up to four pictures with a point or two: no scene.
    camera = CAMERA if known else Camera(240, 180, 240.0, 240.0, 120.0, 90.0)
    with pytest.raises(UserError, match="parallax"):
        reconstruct(room.pictures(room.pan(10)), camera, known)


def test_identical_frames_are_rejected(walk_pictures: Pictures):
    with pytest.raises(UserError, match="0.00 px"):
        reconstruct([walk_pictures[0]] * 5)


def test_blank_pictures_are_rejected_with_their_number_of_features(walk_pictures: Pictures):
    blank = np.full_like(walk_pictures[0], 90)
    with pytest.raises(UserError, match=r"2 of 6 .*50 features .*median 0, most \d{3,}"):
        reconstruct([*walk_pictures[:2], *[blank] * 4])


def test_pictures_of_different_things_are_rejected():
    with pytest.raises(UserError, match="10 pairs"):
        reconstruct([noise(seed) for seed in range(5)])


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_pictures_are_rejected(walk_pictures: Pictures, count: int):
    with pytest.raises(UserError, match=f"3 .*not {count}"):
        reconstruct(walk_pictures[:count])


def test_a_picture_unlike_its_camera_is_a_programming_error(walk_pictures: Pictures):
    with pytest.raises(ValueError, match="picture 1"):
        reconstruct([walk_pictures[0], walk_pictures[1][:-2]])


def test_colmap_leaves_no_temporary_files(
    walk_pictures: Pictures, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    level = pycolmap.logging.minloglevel
    reconstruct(walk_pictures[3:7], workdir=tmp_path)
    with pytest.raises(UserError):
        reconstruct(walk_pictures[:2], workdir=tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert pycolmap.logging.minloglevel == level
    output = capfd.readouterr()
    assert output.out == ""
    assert all(line.startswith("COLMAP: ") for line in output.err.splitlines())
    assert "mapping: 4 of 4 pictures" in output.err


def features_of(pictures: Pictures, valid: NDArray[np.bool_], folder: Path) -> Project:
    project = Project(folder)
    project.write_pictures(pictures, CAMERA)
    project.write_mask(valid)
    project.import_pictures(CAMERA, True)
    project.extract(CAMERA, threads=1)
    return project


def frames_of(pairs: list[tuple[str, str]]) -> set[tuple[int, int]]:
    return {(int(first[:6]), int(second[:6])) for first, second in pairs}


def test_pairs_of_frames_to_match(room: Any, walk_pictures: Pictures, tmp_path: Path):
    back = room.walk(10)[::-1].copy()
    back[:, 2, 3] -= 0.05
    project = features_of([*walk_pictures, *room.pictures(back)], EVERYWHERE, tmp_path)
    assert frames_of(every_pair(project)) == {(a, b) for a in range(20) for b in range(a + 1, 20)}
    pycolmap.set_random_seed(0)
    pairs = sequential_pairs(project, 3, seed=0)
    assert len(pairs) == len(set(pairs))
    found = frames_of(pairs)
    near = {(a, a + step) for a in range(20) for step in (1, 2, 3, 4) if a + step < 20}
    assert near <= found
    # The camera comes back to where it was: its first picture is compared with one of its last three.
    assert found & {(0, 17), (0, 18), (0, 19)}
    pycolmap.set_random_seed(0)
    assert sequential_pairs(project, 3, seed=0) == pairs


def test_sequential_matching_recovers_the_trajectory(walk_pictures: Pictures, true_walk: NDArray[np.float64]):
    poses = reconstruct(walk_pictures, matching="sequential")
    assert poses.notes["matching"] == "sequential"
    assert poses.notes["pairs_compared"] < 45
    assert trajectory_error(poses.camera_to_world, true_walk)["ate_rmse_m"] < 0.005


def test_points_are_filtered_by_track_length_and_error():
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=5, num_points3D=5)
    model = pycolmap.synthesize_dataset(options)
    expected = []
    for (point_id, point), length, error in zip(
        sorted(model.points3D.items()), [2, 3, 3, 2, 5], [0.5, 0.5, 2.5, 9.0, 2.0], strict=True
    ):
        seen = [(element.image_id, element.point2D_idx) for element in point.track.elements]
        for observation in seen[length:]:
            model.delete_observation(*observation)
        point.error = error
        point.color = np.array([point_id, 2, 3], np.uint8)
        if length >= 3 and error <= 2.0:
            expected.append(point)
    points, colours, notes = kept_points(model)
    assert (SHORTEST_TRACK, LARGEST_ERROR_PX) == (3, 2.0)
    assert len(expected) == 2
    np.testing.assert_array_equal(points, [point.xyz for point in expected])
    np.testing.assert_array_equal(colours, [point.color for point in expected])
    assert notes == {
        "points": 2,
        "points_read": 5,
        "points_rejected": {"track_length": 2, "reprojection_error": 2},
    }


@pytest.mark.parametrize("known", [True, False])
def test_real_photographs_are_all_registered(real_data: Callable[[str], Path], known: bool):
    paths = sorted(real_data("tum_fr3_office").glob("*.png"))
    pictures = [cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB) for path in paths]
    camera = TUM_CAMERA if known else Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
    poses = reconstruct(pictures, camera, known)
    assert poses.registered.sum() == len(poses.registered) == 17
    assert poses.notes["reprojection_error_px"] < 1.0
    assert poses.camera.fx == pytest.approx(TUM_CAMERA.fx, rel=0.03)
    assert len(poses.points) > 1000
