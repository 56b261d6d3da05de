"""COLMAP on rendered images with known poses, on unusable images, and on real photographs."""

import tempfile

import cv2
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.colmap.alignment import trajectory_error
from egosplat.calibration.colmap import matching
from egosplat.calibration.colmap.choosing import advice_on_few, find_seam
from egosplat.calibration.colmap.database import Project
from egosplat.calibration.colmap.mapping import MIN_SEEN, drop_loose_images
from egosplat.calibration.colmap.matching import sequential_pairs
from egosplat.errors import UserError
from egosplat.geometry import Camera, make_pose
from egosplat.poses.colmap import colmap_poses
from egosplat.poses.options import PosesOptions
from egosplat.poses.points import filter_points
from tests.support.recordings import synthesized
from tests.unit.poses.conftest import CAMERA

PINHOLE = pycolmap.Camera(model="PINHOLE", width=240, height=180, params=[210.0, 210.0, 120.0, 90.0])
EVERYWHERE = np.ones((CAMERA.height, CAMERA.width), np.bool_)
GUESS = Camera(240, 180, 260.0, 260.0, 120.0, 90.0)


def reconstruct(images, camera=CAMERA, known=True, threads=2, **options):
    valid, keys = np.ones((camera.height, camera.width), np.bool_), PosesOptions(**options)
    return colmap_poses((iter(images), valid, None), camera, known, keys, threads=threads)


def noise(seed):
    return np.random.default_rng(seed).integers(0, 256, (*EVERYWHERE.shape, 3), dtype=np.uint8)


@pytest.fixture(scope="session")
def true_poses(room):
    return room.walk(10)


@pytest.fixture(scope="module")
def estimated(walk_images):
    return reconstruct(walk_images)


def test_colmap_recovers_the_true_trajectory(estimated, true_poses):
    assert estimated.registered.all()
    error = trajectory_error(estimated.camera_to_world, true_poses)
    assert error["ate_rmse_m"] < 0.005  # on a path 2 m long
    assert error["rotation_rmse_deg"] < 0.3
    assert estimated.notes["reprojection_error_px"] < 0.5
    assert estimated.notes["scale"] == "arbitrary" and estimated.camera == CAMERA


def test_points_lie_on_the_planes_of_the_room_in_their_colors(estimated, true_poses):
    error = trajectory_error(estimated.camera_to_world, true_poses)
    # Moved into the first camera's axes, the estimated scene is the true one up to its scale.
    first, true_first = estimated.camera_to_world[0], true_poses[0]
    local = (estimated.points - first[:3, 3]) @ first[:3, :3] * error["scale"]
    world = local @ true_first[:3, :3].T + true_first[:3, 3]
    wall, floor = np.abs(world[:, 2] - 4.0), np.abs(world[:, 1] - 1.2)
    poster = np.abs(world[:, 2] - 2.6 - (world[:, 0] + 0.7) * 0.3 / 1.3)
    off = np.minimum(np.minimum(wall, floor), poster)
    assert np.median(off) < 0.02
    assert all((off == plane).sum() > 20 for plane in (wall, floor, poster))
    assert len(estimated.points) > 300
    assert np.ptp(estimated.point_rgb.astype(int), axis=0).min() > 100


def test_results_do_not_depend_on_the_number_of_threads(walk_images, estimated):
    again = reconstruct(walk_images, threads=1)
    np.testing.assert_array_equal(again.camera_to_world, estimated.camera_to_world)
    np.testing.assert_array_equal(again.points, estimated.points)
    np.testing.assert_array_equal(again.point_rgb, estimated.point_rgb)
    assert again.notes == estimated.notes


def test_a_guessed_focal_length_is_refined(walk_images, true_poses):
    poses = reconstruct(walk_images, GUESS, known=False)
    assert poses.registered.all()
    assert (poses.camera.fx, poses.camera.fy) == pytest.approx((CAMERA.fx, CAMERA.fy), rel=0.01)
    assert (poses.camera.cx, poses.camera.cy) == (GUESS.cx, GUESS.cy)
    assert trajectory_error(poses.camera_to_world, true_poses)["ate_rmse_m"] < 0.01


def test_unrelated_frames_are_left_out_and_reported(walk_images, estimated, true_poses):
    blank = np.full_like(walk_images[0], 90)
    poses = reconstruct([noise(1), *walk_images[:5], blank, *walk_images[5:], noise(2)])
    assert np.flatnonzero(~poses.registered).tolist() == [0, 6, 12]
    assert np.isnan(poses.camera_to_world[~poses.registered]).all()
    assert trajectory_error(poses.camera_to_world[poses.registered], true_poses)["ate_rmse_m"] < 0.005


def test_a_model_with_too_few_images_is_rejected_with_what_to_do(walk_images):
    with pytest.raises(UserError, match="10 of 13 .*poses.min_registered .*80%") as caught:
        reconstruct([*walk_images, *map(noise, range(3))], min_registered=0.8)
    problem, advice = str(caught.value).splitlines()
    assert problem.endswith("10 to 12") and advice.startswith("Set frames.resolution=512, as 240 px")
    assert "frames.stride" not in advice and advice.endswith("poses.min_registered")
    of_small = advice_on_few("sequential", 240, {"resolution": 512, "stride": 3})
    assert "frames.resolution" not in of_small and "poses.matching=exhaustive" in of_small
    assert of_small.startswith("Lower frames.stride")
    assert "frames.resolution" not in advice_on_few("exhaustive", 512, {})


def test_two_places_without_a_common_view_give_the_larger_one(room, capsys):
    other = type(room)()
    other.textures = [np.ascontiguousarray(255 - one[:, ::-1]) for one in room.textures]
    images = [*room.images(room.walk(9)), *other.images(other.walk(7))]
    poses = reconstruct(images, min_registered=0.4)
    assert poses.notes["models"] == [9, 7]
    assert poses.registered.tolist() == [True] * 9 + [False] * 7
    told = capsys.readouterr().err
    assert "a model of 7 frames (9 to 15) is left out: too little connects it" in told
    assert "record the ways between them" in told and "7 of 16 frames have no pose" in told


@pytest.mark.parametrize("known", [True, False])
def test_a_rotating_camera_is_rejected(room, known):
    # With this guess COLMAP builds models of up to four images with one or two points.
    camera = CAMERA if known else Camera(240, 180, 240.0, 240.0, 120.0, 90.0)
    with pytest.raises(UserError, match="parallax"):
        reconstruct(room.images(room.pan(10)), camera, known)


def test_blank_images_are_rejected_with_their_number_of_features(walk_images):
    blank = np.full_like(walk_images[0], 90)
    with pytest.raises(UserError, match=r"2 of 6 .*50 features .*median 0, maximum \d{3,}"):
        reconstruct([*walk_images[:2], *[blank] * 4])


def test_too_few_images_are_rejected_and_no_file_is_left(walk_images, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    reconstruct(walk_images[3:7])
    for count in (0, 2):
        with pytest.raises(UserError, match=f"3 .*not {count}"):
            reconstruct(walk_images[:count])
    assert list(tmp_path.iterdir()) == []
    output = capfd.readouterr()
    assert output.out == ""
    assert all(line.startswith("COLMAP: ") for line in output.err.splitlines())
    assert "mapping: 4/4 images" in output.err


def features_of(images, folder, shown=None):
    project = Project(folder, PINHOLE)
    project.write_images(images)
    project.write_masks(EVERYWHERE, shown)
    project.import_images()
    project.extract(threads=1)
    return project


def test_frames_are_matched_with_neighbors_and_places_seen_again(room, walk_images, tmp_path, monkeypatch):
    back = room.walk(10)[::-1].copy()
    back[:, 2, 3] -= 0.05
    project = features_of([*walk_images, *room.images(back)], tmp_path)
    pycolmap.set_random_seed(0)
    pairs = sequential_pairs(project, 3)
    assert len(pairs) == len(set(pairs))
    found = {(int(first[:6]), int(second[:6])) for first, second in pairs}
    near = {(a, a + step) for a in range(20) for step in (1, 2, 3, 4) if a + step < 20}
    assert near <= found
    # The camera returns to its start: the first image is paired with one of the last three.
    assert found & {(0, 17), (0, 18), (0, 19)}
    pycolmap.set_random_seed(0)
    assert sequential_pairs(project, 3) == pairs
    # Of a recording with fewer features than centers of them, pairs near in time are still matched.
    monkeypatch.setattr(matching, "_SAMPLE", 1)
    assert near <= {(int(first[:6]), int(second[:6])) for first, second in sequential_pairs(project, 3)}


def test_images_with_few_features_get_weaker_ones(walk_images, tmp_path, monkeypatch):
    def features(folder, enough):
        (tmp_path / folder).mkdir()
        monkeypatch.setattr("egosplat.calibration.colmap.database._ENOUGH_FEATURES", enough)
        faint = [walk_images[0], *(90 + (image - 90.0) / 8 for image in walk_images[1:3])]
        project = features_of([np.asarray(image, np.uint8) for image in faint], tmp_path / folder)
        with pycolmap.Database.open(project.database) as database:
            return [len(database.read_keypoints(number)) for number in (1, 2, 3)]

    sharp, *few = features("strong", 0)
    same, *more = features("weak", sharp)
    assert same == sharp and min(more) > 2 * max(few)


def test_points_are_filtered_by_track_length_and_error():
    model = synthesized(0, 5, 5)
    lengths, errors, expected = [2, 3, 3, 2, 5], [0.5, 0.5, 2.5, 9.0, 2.0], []
    for (point_id, point), length, error in zip(sorted(model.points3D.items()), lengths, errors, strict=True):
        seen = [(element.image_id, element.point2D_idx) for element in point.track.elements]
        for observation in seen[length:]:
            model.delete_observation(*observation)
        point.error = error
        point.color = np.array([point_id, 2, 3], np.uint8)
        if length >= 3 and error <= 2.0:
            expected.append(point)
    points, colors = filter_points(model)
    assert len(expected) == 2
    np.testing.assert_array_equal(points, [point.xyz for point in expected])
    np.testing.assert_array_equal(colors, [point.color for point in expected])


def test_an_image_that_sees_few_points_of_a_model_has_no_pose():
    model = synthesized(1, 5, 2 * MIN_SEEN)
    points = [index for index, point in enumerate(model.images[3].points2D) if point.has_point3D()]
    for index in points[MIN_SEEN - 1 :]:
        model.delete_observation(3, index)
    drop_loose_images(model)
    assert sorted(model.reg_image_ids()) == [1, 2, 4, 5]


def test_the_weakest_place_of_a_model_in_time_is_found():
    model = synthesized(1, 12, 40)
    for number, image in model.images.items():
        image.name = f"{number:06d}.png"
    assert find_seam(model)["share"] == 1.0
    # All but three points are seen up to the seventh frame, or later.
    for number in sorted(model.points3D)[3:]:
        seen = [(one.image_id, one.point2D_idx) for one in model.points3D[number].track.elements]
        for image, index in seen:
            if (image <= 7) == (number % 2 == 0):
                model.delete_observation(image, index)
    seam = find_seam(model)
    assert seam["after"] == 7 and 0.0 < seam["share"] < 0.2


@pytest.mark.slow
def test_real_photographs_are_all_registered_and_their_camera_is_found(real_data):
    paths = sorted(real_data("tum_fr3_office").glob("*.png"))
    images = [cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB) for path in paths]
    poses = reconstruct(images, Camera(640, 480, 600.0, 600.0, 320.0, 240.0), known=False)
    assert poses.registered.sum() == len(poses.registered) == 17
    assert poses.notes["reprojection_error_px"] < 1.0
    assert poses.camera.fx == pytest.approx(535.4, rel=0.03)
    assert len(poses.points) > 1000


def test_no_feature_lies_where_an_image_s_own_mask_leaves_pixels_out(walk_images, tmp_path):
    shown = np.stack([EVERYWHERE] * 3)
    shown[:, :30], shown[1, :, :120], shown[2, :, 120:] = False, False, False
    project = features_of(walk_images[:3], tmp_path, shown)
    with pycolmap.Database.open(project.database) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.name)
        points = [np.asarray(database.read_keypoints(image.image_id))[:, :2] for image in images]
    assert min(map(len, points)) > 50 and min(one[:, 1].min() for one in points) > 30
    assert points[1][:, 0].min() > 120 and points[2][:, 0].max() < 120
    assert points[0][:, 0].min() < 110 and points[0][:, 0].max() > 130


def test_errors_of_trajectories_are_root_mean_squares():
    rng = np.random.default_rng(1)
    true = make_pose(Rotation.random(200, rng).as_matrix(), rng.normal(size=(200, 3)))
    turned = Rotation.from_matrix(true[:, :3, :3]) * Rotation.from_euler("x", 2.0, degrees=True)
    estimated = make_pose(turned.as_matrix(), true[:, :3, 3] + rng.normal(0.0, 0.01, (200, 3)))
    error = trajectory_error(estimated, true)
    assert error["ate_rmse_m"] == pytest.approx(0.01 * np.sqrt(3.0), rel=0.1)
    assert error["rotation_rmse_deg"] == pytest.approx(2.0, rel=0.02)
