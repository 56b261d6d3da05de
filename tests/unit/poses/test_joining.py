"""Models of COLMAP's that share frames become one; others are left out with the reason."""

import numpy as np
import pycolmap
import pytest

from egosplat.calibration.colmap.joining import join_models
from tests.support.models import synthesized

TURNED = pycolmap.Sim3d(
    0.37, pycolmap.Rotation3d(np.array([0, 0, np.sin(0.4), np.cos(0.4)])), [1.0, 2.0, 3.0]
)


@pytest.fixture(scope="module")
def whole():
    """Twelve images of a hundred points, located to 0.3 px."""
    model = synthesized(1, 12, 100, 0.3)
    model.update_point_3d_errors()
    return model


def part(whole, first, last):
    """The model of images ``first`` to ``last``."""
    model = pycolmap.Reconstruction(whole)
    for frame in [one for one in model.reg_frame_ids() if not first <= one <= last]:
        model.deregister_frame(frame)
    model.tear_down()
    return model


def centers(model):
    return {number: model.images[number].projection_center() for number in model.reg_image_ids()}


def test_models_with_shared_frames_are_joined(whole):
    second = part(whole, 6, 12)
    second.transform(TURNED)
    model, parts, left = join_models([second, part(whole, 1, 8)], camera_known=True)
    assert parts == 2 and left == [] and model.num_reg_images() == 12
    found, true = centers(model), centers(whole)
    scale = np.linalg.norm(true[1] - true[12]) / np.linalg.norm(found[1] - found[12])
    for number in true:
        away = np.linalg.norm(found[number] - found[1]) * scale
        assert away == pytest.approx(np.linalg.norm(true[number] - true[1]), abs=0.02)
    assert model.num_points3D() == 100 and model.compute_mean_track_length() > 11.9


def test_a_chain_of_models_is_joined_whatever_its_order(whole):
    models = [part(whole, 1, 6), part(whole, 8, 12), part(whole, 4, 10)]
    models[1].transform(TURNED)
    model, parts, _ = join_models(models, camera_known=True)
    assert parts == 3 and model.num_reg_images() == 12


def test_models_that_share_too_little_are_left_out_with_the_reason(whole):
    model, parts, left = join_models([part(whole, 1, 7), part(whole, 6, 12)], camera_known=True)
    assert parts == 1 and model.num_reg_images() == 7
    ((other, reason),) = left
    assert other.num_reg_images() == 7 and "shares 2 frames" in reason


def test_models_that_do_not_fit_are_not_joined(whole):
    second = part(whole, 6, 12)
    rng = np.random.default_rng(0)
    for point in second.points3D.values():
        point.xyz = point.xyz + rng.normal(size=3) * 2.0
    for number in second.reg_image_ids():
        frame = second.images[number].frame
        moved = frame.rig_from_world
        moved.translation = moved.translation + rng.normal(size=3)
        frame.rig_from_world = moved
    model, parts, ((_, reason),) = join_models([part(whole, 1, 8), second], camera_known=True)
    assert parts == 1 and model.num_reg_images() == 8 and "largest model" in reason
