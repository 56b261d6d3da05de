"""Blurred frames are dropped where sharper frames show the same, and no place is lost."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.artifacts.kept_frames import frames_for_gaussians, kept_frames
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES
from egosplat.geometry import Camera, make_pose
from egosplat.survey.sharpness import Views, find_blurred, measure_all
from tests.unit.survey.test_stage import surveyed

CAMERA = Camera(64, 64, 32.0, 32.0, 32.0, 32.0)


def views(yaws, depth=2.0, valid=None) -> Views:
    """Views of a camera that turns in place [deg]."""
    rotations = Rotation.from_euler("y", np.asarray(yaws, float)[:, None], degrees=True).as_matrix()
    valid = np.ones((64, 64), bool) if valid is None else valid
    poses = make_pose(rotations, np.zeros((len(yaws), 3)))
    return Views(CAMERA, poses, np.full(len(yaws), depth), lambda _: valid)


def dropped(values, yaws, optional=None, trained=None, limit=4.0) -> list[int]:
    everywhere = np.ones(len(yaws), bool)
    trained, optional = (everywhere if one is None else one for one in (trained, optional))
    values = np.asarray(values, float)
    return list(find_blurred(values, views(yaws), trained, optional, limit).replaced_by)


def test_a_blurred_frame_between_sharp_ones_is_dropped():
    found = find_blurred(
        np.array([2.0, 2.1, 0.8, 2.0]), views([0, 4, 6, 8]), *[np.ones(4, bool)] * 2, min_scatters=4.0
    )
    assert found.replaced_by == {2: [0, 1, 3]}
    assert found.scatter == pytest.approx(0.1, abs=0.06) and found.min_difference == 0.5
    assert dropped([2.0, 2.1, 0.8, 2.0], [0, 4, 6, 8], limit=0) == []


def test_a_difference_within_the_scatter_is_no_blur():
    """Protects recordings whose sharpness differs from frame to frame."""
    assert dropped([2.0, 1.0, 2.0, 1.2, 2.1, 0.9], [0, 1, 2, 3, 4, 5]) == []
    assert dropped([2.0, 1.6, 2.0, 2.0], [0, 1, 2, 3]) == []


def test_no_place_is_left_unseen():
    """Protects the side of a view that no sharper frame shows."""
    assert dropped([2.0, 2.1, 2.0, 0.5], [0, 1, 2, 15]) == []
    assert dropped([2.0, 2.1, 2.0, 0.5, 2.0], [0, 1, 2, 15, 30]) == [3]
    assert dropped([2.0, 2.1, 2.0, 0.5, 0.6], [0, 1, 2, 15, 30]) == []
    assert dropped([0.5] * 6, range(6)) == []


def test_frames_that_may_not_be_dropped_stay_and_others_do_not_stand_in():
    """Protects evaluation frames: they are kept, and no training frame is dropped on their account."""
    optional = np.array([True, True, False, True])
    assert dropped([2.0, 2.1, 0.8, 2.0], [0, 4, 6, 8], optional) == []
    only_evaluated = np.array([False, False, True, False])
    assert dropped([2.0, 2.1, 0.8, 2.0], [0, 4, 6, 8], only_evaluated, only_evaluated) == []


@pytest.mark.parametrize("values", [[np.nan] * 4, [2.0, np.nan, np.nan, np.nan], [2.0]])
def test_without_edges_or_neighbors_nothing_is_dropped(values):
    """Protects black frames and a recording of one frame."""
    found = find_blurred(
        np.array(values), views(range(len(values))), *[np.ones(len(values), bool)] * 2, min_scatters=4.0
    )
    assert found.replaced_by == {} and found.scatter is found.min_difference is None


def test_frames_without_a_pose_or_depth_stay():
    all_of_them = np.ones(4, bool)
    unknown = views([0, 4, 6, 8])
    unknown.depths[2] = np.nan
    assert not find_blurred(
        np.array([2.0, 2.1, 0.8, 2.0]), unknown, all_of_them, all_of_them, 4.0
    ).replaced_by
    unknown = views([0, 4, 6, 8])
    unknown.camera_to_world[2] = np.nan
    assert not find_blurred(
        np.array([2.0, 2.1, 0.8, 2.0]), unknown, all_of_them, all_of_them, 4.0
    ).replaced_by


def test_a_blurred_frame_trains_nothing(scene, trajectory, still):
    """Protects the way from the picture to the lists of frames, also that of Gaussians in a static scene."""
    edges = [np.where(one > 128, 170, 80).astype(np.uint8) for one in still]
    blurred = [cv2.blur(one, (1, 9)) if frame == 4 else one for frame, one in enumerate(edges)]
    folder = scene(trajectory, blurred)
    found = surveyed(folder, min_view_change_deg=0.0)
    assert [one["frame"] for one in found["sharpness"]["dropped"]] == [4] == found["views"]["left_out"]
    assert found["motion"]["static"]
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    for kept, recorded in (
        kept_frames(frames, folder / "survey.json"),
        frames_for_gaussians(frames, folder / "survey.json", "none"),
    ):
        assert np.flatnonzero(~kept).tolist() == [4] and recorded == {"kept_frames": found["views"]["digest"]}
    assert surveyed(folder, min_view_change_deg=0.0, blur_limit=0.0)["views"]["left_out"] == []


def test_a_place_that_a_frame_leaves_out_is_not_shown_there():
    """Frame 2 is blurred; the sharper frames hide its middle, or it hides its middle itself."""
    hidden = np.ones((64, 64), bool)
    hidden[20:44, 16:48] = False
    for hiding, replaced in (((0, 1, 3), []), ((0, 1), [2]), ((0, 1, 2, 3), [2])):
        shown = {frame: hidden if frame in hiding else np.ones((64, 64), bool) for frame in range(4)}
        seen = replace(views([0, 4, 6, 8], valid=np.ones((64, 64), bool)), shown_in=shown.__getitem__)
        found = find_blurred(np.array([2.0, 2.1, 0.8, 2.0]), seen, *[np.ones(4, bool)] * 2, min_scatters=4.0)
        assert list(found.replaced_by) == replaced


def test_edges_that_a_frame_leaves_out_do_not_make_it_sharp(scene, trajectory, still):
    """Frame 4 is blurred but for its upper half, which its mask hides."""
    blurred, masked = cv2.blur(still[4], (15, 15)), np.zeros((len(still), *still[4].shape[:2]), bool)
    half = len(blurred) // 2
    blurred[:half], masked[4, :half] = still[4][:half], True
    images = [blurred if frame == 4 else one for frame, one in enumerate(still)]
    values = [
        measure_all(open_artifact(scene(trajectory, images, **own) / "frames.zarr", FRAMES))
        for own in ({}, {"masked": masked})
    ]
    assert values[1][4] < values[0][4] - 0.5 and (np.delete(values[1], 4) == np.delete(values[0], 4)).all()
